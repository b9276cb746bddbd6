//! The list of codes, compared with the sources in both directions.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use isomark::reason::{Code, CodeKind};

use super::{Named, Text, paths, texts, walk, without_comments_and_texts, without_tests};

/// What makes a reason or notice of a code, its first argument.
const MAKERS: [([&str; 2], CodeKind); 3] = [
    (["Reason", "new"], CodeKind::Reason),
    (["Notice", "note"], CodeKind::Notice),
    (["Notice", "warning"], CodeKind::Notice),
];

/// Words in kebab case that are no codes, in files that hand codes on.
const OTHER_WORDS: &[&str] = &[];

/// The codes of a file: those that are given to a maker, and, where a maker is given something else than a text or is
/// handed on itself, all words in kebab case.
#[derive(Default)]
struct Found {
    given: BTreeMap<String, Vec<CodeKind>>,
    handed_on: BTreeSet<String>,
}

impl Found {
    fn add(&mut self, source: &str) {
        let code = without_tests(&without_comments_and_texts(source));
        let texts = texts(source);
        let mut is_handed_on = false;
        for Named { at, steps, .. } in paths(&code) {
            let Some((_, kind)) = MAKERS.iter().find(|(maker, _)| steps.ends_with(&maker.map(String::from)))
            else {
                continue;
            };
            match argument(source, at, &texts) {
                Some(code) => self.given.entry(code.to_owned()).or_default().push(*kind),
                None => is_handed_on = true,
            }
        }
        if is_handed_on {
            let words = texts.into_iter().map(|text| text.text).filter(|text| is_kebab_case(text));
            self.handed_on.extend(words.filter(|word| !OTHER_WORDS.contains(&word.as_str())));
        }
    }
}

/// The text that is the first argument of a call which starts here.
fn argument<'t>(source: &str, at: usize, texts: &'t [Text]) -> Option<&'t str> {
    let mut rest = source.chars().enumerate().skip(at).skip_while(|(_, c)| super::is_word(*c) || *c == ':');
    let first = match rest.next() {
        Some((_, '(')) => rest.find(|(_, c)| !c.is_whitespace())?.0,
        _ => return None,
    };
    texts.iter().find(|text| text.at == first).map(|text| text.text.as_str())
}

fn is_kebab_case(text: &str) -> bool {
    let is_letter = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit();
    text.contains('-') && text.split('-').all(|word| !word.is_empty() && word.chars().all(is_letter))
}

#[test]
fn every_code_of_the_sources_is_in_the_list_and_every_entry_is_used() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut found = Found::default();
    for file in walk(&root) {
        // Where they are made and listed.
        let is_home = file.starts_with(root.join("reason")) || file == root.join("reason.rs");
        if !is_home && !file.ends_with("tests.rs") {
            found.add(&std::fs::read_to_string(file).unwrap());
        }
    }
    let mut complaints = Vec::new();
    for (code, kinds) in &found.given {
        match Code::named(code) {
            None => complaints.push(format!("{code} is missing in the list")),
            Some(entry) => complaints.extend(
                kinds
                    .iter()
                    .find(|kind| ![**kind, CodeKind::Both].contains(&entry.kind))
                    .map(|kind| format!("{code} is used as {kind:?} and listed as {:?}", entry.kind)),
            ),
        }
    }
    let missing = found.handed_on.iter().filter(|word| Code::named(word).is_none());
    complaints.extend(missing.map(|word| format!("{word} is missing in the list, or is no code")));
    let is_used = |code: &str| found.given.contains_key(code) || found.handed_on.contains(code);
    let unused = Code::ALL.iter().filter(|code| !is_used(code.code));
    complaints.extend(unused.map(|code| format!("{} is in the list, and nothing uses it", code.code)));
    assert!(complaints.is_empty(), "src/reason/codes.rs:\n{}\n", complaints.join("\n"));
}

#[test]
fn a_code_is_found_where_it_is_made() {
    let found = |source: &str| {
        let mut found = Found::default();
        found.add(source);
        (found.given.into_keys().collect::<Vec<_>>(), found.handed_on.into_iter().collect::<Vec<_>>())
    };
    let none = Vec::<String>::new();
    assert_eq!(found("Reason::new(\n  \"a-b\", \"c-d\", x)"), (vec!["a-b".into()], none.clone()));
    assert_eq!(
        found("crate::reason::Notice::note(\"plain\", \"x-y\")"),
        (vec!["plain".into()], none.clone())
    );
    // Handed on: as a variable, a constant, a method's result, or the maker itself.
    for maker in
        ["Reason::new(code", "Reason::new(CODE", "Reason::new(self.code()", "let f = Notice::warning; f(x"]
    {
        let source = format!("let code = \"a-b\"; let text = \"No code-like word\"; {maker}, \"Text.\")");
        assert_eq!(found(&source), (none.clone(), vec!["a-b".into()]), "{maker}");
    }
    // Comments, tests and other constructors make none.
    let source = "// Reason::new(\"a-b\")\n#[cfg(test)]\nmod tests { fn f() { Reason::new(\"c-d\") } }\nOther::new(\"e-f\")";
    assert_eq!(found(source), (none.clone(), none));
}
