//! The newest result of each name. A station remembers a hundred thousand of them, so each is packed into one block of
//! bytes, with one byte for two digits of a hash.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Bound::{Excluded, Unbounded};
use std::sync::Arc;

use super::line::{Certainty, Import, Job, Line, Record};
use crate::config::{Sku, fold};
use crate::hotfolder::jobs::is_comparable;
use crate::hotfolder::state::DropId;

/// The newest result of a name.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Delivered {
    pub(crate) job: Job,
    /// When it was delivered.
    pub(crate) at: String,
    /// Its original in the archive, relative to the SKU's folder; empty if it is not in the archive.
    pub(crate) original: String,
    pub(crate) import: Import,
    /// Whether its delivery is certain.
    pub(crate) certainty: Certainty,
    /// Hash of the older result that is in BeamConstruct until this one is imported.
    pub(super) older: String,
}

impl Delivered {
    /// Whether this is its name: that of the drawing or that of the drop, in any spelling.
    pub(crate) fn is_called(&self, name: &str) -> bool {
        [&self.job.name, &self.job.drop.to_string()].iter().any(|known| fold(known) == fold(name))
    }

    /// Whether it can be corrected again, but an older version wrote its basis, so that it is unknown whether it is
    /// outdated.
    pub(crate) fn is_of_older_form(&self) -> bool {
        !self.original.is_empty() && !is_comparable(&self.job.basis)
    }

    /// The line for this result.
    pub(super) fn line(self) -> Line {
        let Self { job, at, original, import, certainty, older } = self;
        Line { at, record: Record::Done { job, original, import, older, certainty, ends: None } }
    }

    /// Hash of the result that the marking software has.
    pub(crate) fn held(&self) -> &str {
        if self.import == Import::Due { &self.older } else { &self.job.result }
    }
}

/// Results by their folded names: on a Windows share, two spellings are one file.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(super) struct Results {
    all: BTreeMap<Arc<str>, Packed>,
    by_sku: BTreeMap<Sku, BTreeSet<Arc<str>>>,
    uncertain: BTreeSet<Arc<str>>,
    /// Number of results whose basis an older version wrote.
    of_older_form: usize,
}

impl Results {
    pub(super) fn len(&self) -> usize {
        self.all.len()
    }

    pub(super) fn get(&self, name: &str) -> Option<Delivered> {
        self.all.get(&*fold(name))?.unpack()
    }

    /// Adds a result, replacing an older one with its name; returns the folded name.
    pub(super) fn insert(&mut self, result: &Delivered) -> Arc<str> {
        self.remove(&result.job.name);
        let name: Arc<str> = fold(&result.job.name).into();
        if let Ok(sku) = result.job.sku.parse::<Sku>() {
            self.by_sku.entry(sku).or_default().insert(name.clone());
        }
        if result.certainty == Certainty::Uncertain {
            self.uncertain.insert(name.clone());
        }
        self.of_older_form += usize::from(result.is_of_older_form());
        self.all.insert(name.clone(), Packed::of(result));
        name
    }

    pub(super) fn remove(&mut self, name: &str) {
        let name = fold(name);
        self.uncertain.remove(&*name);
        let Some(result) = self.all.remove(&*name).and_then(|result| result.unpack()) else { return };
        self.of_older_form -= usize::from(result.is_of_older_form());
        let Ok(sku) = result.job.sku.parse::<Sku>() else { return };
        if let Some(names) = self.by_sku.get_mut(&sku) {
            names.remove(&*name);
            if names.is_empty() {
                self.by_sku.remove(&sku);
            }
        }
    }

    /// All results in the order of their folded names.
    pub(super) fn iter(&self) -> impl Iterator<Item = Delivered> {
        self.all.values().filter_map(Packed::unpack)
    }

    /// Up to `limit` results after a folded name, with the folded name of the last one.
    pub(super) fn after(&self, name: Option<&str>, limit: usize) -> (Vec<Delivered>, Option<Arc<str>>) {
        let start = name.map_or(Unbounded, Excluded);
        let some: Vec<_> = self.all.range::<str, _>((start, Unbounded)).take(limit).collect();
        let last = some.last().map(|(name, _)| Arc::clone(name));
        (some.into_iter().filter_map(|(_, result)| result.unpack()).collect(), last)
    }

    /// Up to `limit` results of a SKU after a folded name, with the folded name of the last one.
    pub(super) fn of_sku(
        &self,
        sku: &Sku,
        after: Option<&str>,
        limit: usize,
    ) -> (Vec<Delivered>, Option<Arc<str>>) {
        let Some(names) = self.by_sku.get(sku) else { return (Vec::new(), None) };
        let start = after.map_or(Unbounded, Excluded);
        let some: Vec<_> = names.range::<str, _>((start, Unbounded)).take(limit).collect();
        let results = some.iter().filter_map(|name| self.all.get(*name)?.unpack()).collect();
        (results, some.last().map(|name| Arc::clone(name)))
    }

    pub(super) fn uncertain(&self) -> impl Iterator<Item = Delivered> {
        self.uncertain.iter().filter_map(|name| self.all.get(name)?.unpack())
    }

    pub(super) fn of_older_form(&self) -> usize {
        self.of_older_form
    }

    /// The SKUs with results.
    pub(super) fn skus(&self) -> impl Iterator<Item = &Sku> {
        self.by_sku.keys()
    }

    pub(super) fn has_any_of(&self, sku: &Sku) -> bool {
        self.by_sku.contains_key(sku)
    }
}

/// A result in one block of bytes.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Packed(Box<[u8]>);

/// A text that is stored unchanged.
const TEXT: u8 = 0;
/// A text of hexadecimal digits in lower case, with two digits per byte.
const HEXADECIMAL: u8 = 1;
/// A text that is the same as the result's name.
const NAME: u8 = 2;

impl Packed {
    fn of(result: &Delivered) -> Self {
        let Delivered { job, at, original, import, certainty, older } = result;
        let Job { drop, sku, name, key, basis, pattern, result } = job;
        let import = match import {
            Import::ByFolder => 0,
            Import::Due => 1,
            Import::Done => 2,
        };
        let mut bytes = vec![import, u8::from(*certainty == Certainty::Uncertain)];
        put(&mut bytes, name, "");
        // A basis consists of its form, a colon and a hash.
        let (form, hash) = basis.rsplit_once(':').map_or(("", &**basis), |(form, hash)| (form, hash));
        bytes.push(u8::from(basis.contains(':')));
        for text in [&drop.to_string(), sku, key, form, hash, pattern, result, at, original, older] {
            put(&mut bytes, text, name);
        }
        Self(bytes.into())
    }

    /// The result; never `None`, because all bytes come from [`Packed::of`].
    fn unpack(&self) -> Option<Delivered> {
        let mut bytes = &*self.0;
        let import = match take(&mut bytes, 1)? {
            [0] => Import::ByFolder,
            [1] => Import::Due,
            _ => Import::Done,
        };
        let certainty = if take(&mut bytes, 1)? == [0] { Certainty::Certain } else { Certainty::Uncertain };
        let name = text(&mut bytes, "")?;
        let has_form = take(&mut bytes, 1)? == [1];
        let mut next = || text(&mut bytes, &name);
        let (drop, sku, key, form, hash) = (DropId::from(next()?), next()?, next()?, next()?, next()?);
        let (pattern, result, at, original, older) = (next()?, next()?, next()?, next()?, next()?);
        let basis = if has_form { format!("{form}:{hash}") } else { hash };
        let job = Job { drop, sku, name, key, basis, pattern, result };
        Some(Delivered { job, at, original, import, certainty, older })
    }
}

fn put(bytes: &mut Vec<u8>, text: &str, name: &str) {
    let is_hexadecimal =
        text.len().is_multiple_of(2) && text.bytes().all(|byte| matches!(byte, b'0'..=b'9' | b'a'..=b'f'));
    let value = |digit: u8| if digit.is_ascii_digit() { digit - b'0' } else { digit - b'a' + 10 };
    if text == name && !name.is_empty() {
        bytes.push(NAME);
    } else if is_hexadecimal {
        bytes.push(HEXADECIMAL);
        put_length(bytes, text.len() / 2);
        bytes.extend(text.as_bytes().chunks_exact(2).map(|pair| value(pair[0]) << 4 | value(pair[1])));
    } else {
        bytes.push(TEXT);
        put_length(bytes, text.len());
        bytes.extend(text.as_bytes());
    }
}

/// Seven bits per byte, the low ones first; the last byte is below 128.
fn put_length(bytes: &mut Vec<u8>, mut length: usize) {
    while length >= 128 {
        bytes.push((length % 128) as u8 + 128);
        length /= 128;
    }
    bytes.push(length as u8);
}

fn take<'b>(bytes: &mut &'b [u8], count: usize) -> Option<&'b [u8]> {
    let (taken, rest) = bytes.split_at_checked(count)?;
    *bytes = rest;
    Some(taken)
}

fn text(bytes: &mut &[u8], name: &str) -> Option<String> {
    let kind = *take(bytes, 1)?.first()?;
    if kind == NAME {
        return Some(name.to_owned());
    }
    let (mut length, mut factor) = (0, 1);
    loop {
        let byte = usize::from(*take(bytes, 1)?.first()?);
        length += byte % 128 * factor;
        if byte < 128 {
            break;
        }
        factor *= 128;
    }
    let content = take(bytes, length)?;
    match kind {
        HEXADECIMAL => Some(content.iter().map(|byte| format!("{byte:02x}")).collect()),
        _ => String::from_utf8(content.to_vec()).ok(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn result(words: &[String; 9], import: Import, certainty: Certainty) -> Delivered {
        let [drop, sku, name, key, basis, pattern, result, original, older] = words.clone();
        let job = Job { drop: DropId::from(drop), sku, name, key, basis, pattern, result };
        Delivered { job, at: "2026-03-01T12:34:56Z".into(), original, import, certainty, older }
    }

    proptest! {
        #[test]
        fn a_packed_result_is_unpacked_unchanged(
            words in proptest::array::uniform9("(|[0-9a-f]{32}|v[0-9]:[0-9a-f]{64}|archive:can/[a-c(). 0-9/]{1,9}|.{0,200}|:+)"),
            import in proptest::sample::select(vec![Import::ByFolder, Import::Due, Import::Done]),
            certain in any::<bool>(),
            same in any::<bool>(),
        ) {
            let certainty = if certain { Certainty::Certain } else { Certainty::Uncertain };
            let mut words = words;
            if same {
                words[7] = words[2].clone();
            }
            let expected = result(&words, import, certainty);
            prop_assert_eq!(Packed::of(&expected).unpack(), Some(expected));
        }
    }

    #[test]
    fn a_typical_result_takes_a_quarter_of_its_line() {
        let hash = |byte: &str| byte.repeat(32);
        let words = ["mug@date.dxf", "mug", "mug@date.dxf", &hash("ab")[..32], &format!("v2:{}", hash("cd"))];
        let rest = [&*hash("01"), &*hash("ef"), "mug@date.dxf", ""];
        let words: Vec<String> = words.into_iter().chain(rest).map(str::to_owned).collect();
        let packed = Packed::of(&result(&words.try_into().unwrap(), Import::ByFolder, Certainty::Certain));
        assert!(packed.0.len() < 180, "{} bytes", packed.0.len());
    }

    #[test]
    fn results_are_found_by_name_by_sku_and_in_slices() {
        let mut results = Results::default();
        let named = |name: &str, sku: &str, certainty| {
            let mut words: [String; 9] = Default::default();
            (words[1], words[2]) = (sku.into(), name.into());
            result(&words, Import::ByFolder, certainty)
        };
        for name in ["a.dxf", "C.dxf", "b.dxf"] {
            results.insert(&named(name, "Can", Certainty::Certain));
        }
        results.insert(&named("d.dxf", "mug", Certainty::Uncertain));
        results.insert(&named("c.dxf", "mug", Certainty::Certain));
        let (can, mug): (Sku, Sku) = ("can".parse().unwrap(), "mug".parse().unwrap());
        let names = |(results, last): (Vec<Delivered>, Option<Arc<str>>)| {
            (
                results.into_iter().map(|result| result.job.name).collect::<Vec<_>>(),
                last.map(|last| last.to_string()),
            )
        };
        let some = |names: &[&str], last: &str| {
            (names.iter().map(|name| name.to_string()).collect(), Some(last.to_owned()))
        };
        assert_eq!(names(results.of_sku(&can, None, 9)), some(&["a.dxf", "b.dxf"], "b.dxf"));
        assert_eq!(names(results.of_sku(&mug, Some("c.dxf"), 9)), some(&["d.dxf"], "d.dxf"));
        assert_eq!(names(results.after(None, 3)), some(&["a.dxf", "b.dxf", "c.dxf"], "c.dxf"));
        assert_eq!(names(results.after(Some("d.dxf"), 3)), (vec![], None));
        assert_eq!(results.uncertain().count(), 1);
        results.remove("D.dxf");
        results.remove("c.dxf");
        assert!(!results.has_any_of(&mug) && results.uncertain().count() == 0 && results.len() == 2);
    }
}
