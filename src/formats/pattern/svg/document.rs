//! The bytes of a file as XML, with places for messages.

use std::borrow::Cow;

use roxmltree::{Document, Error, Node, ParsingOptions};

use super::super::budget::Cost;
use super::super::error::{EntityName, PatternReadError, Spot};

/// Largest file, bytes.
const MAX_BYTES: usize = 200 << 20;
/// Number of bytes that are searched for the root element.
const HEAD: usize = 1 << 16;
/// Deepest nesting in the file.
const MAX_DEPTH: usize = 500;
/// Largest size of all replaced entities together, bytes.
const MAX_REPLACED: usize = 16 << 20;

/// An attribute of SVG: one without a prefix. Those of editors, such as `sodipodi:cx`, may have the same names.
pub(super) fn attribute<'a>(node: Node<'a, '_>, name: &str) -> Option<&'a str> {
    let own = node.attributes().find(|attribute| attribute.namespace().is_none() && attribute.name() == name);
    own.map(|attribute| attribute.value())
}

/// Whether the bytes begin as an SVG file does, as far as they reach.
pub(in super::super) fn is_svg(bytes: &[u8]) -> bool {
    let head = decoded(&bytes[..bytes.len().min(HEAD)]);
    let mut rest = head.trim_start();
    let mut is_xml = false;
    loop {
        let end = match rest {
            _ if rest.starts_with("<?") => "?>",
            _ if rest.starts_with("<!--") => "-->",
            _ if rest.starts_with("<!DOCTYPE") => {
                let name = rest["<!DOCTYPE".len()..].trim_start();
                return name.starts_with("svg") || "svg".starts_with(name);
            }
            "" => return is_xml,
            _ => break,
        };
        is_xml = true;
        match rest.find(end) {
            Some(found) => rest = rest[found + end.len()..].trim_start(),
            None => return true,
        }
    }
    let Some(rest) = rest.strip_prefix('<') else { return false };
    let end = rest.find(|letter: char| letter.is_whitespace() || matches!(letter, '>' | '/'));
    let name = &rest[..end.unwrap_or(rest.len())];
    let local = name.rsplit(':').next().unwrap_or(name);
    local == "svg" || (end.is_none() && is_xml && "svg".starts_with(local))
}

/// Whether the file is complete: its last element is closed, and no other `svg` is still open.
pub(in super::super) fn is_complete(bytes: &[u8]) -> bool {
    let text = decoded(bytes);
    let (mut opened, mut closed, mut last) = (0, 0, None);
    for (at, _) in text.match_indices('<') {
        let tag = &text[at + 1..];
        let (name, is_end) = match tag.strip_prefix('/') {
            Some(name) => (name, true),
            None => (tag, false),
        };
        let name = &name[..name
            .find(|c: char| !(c.is_ascii_alphanumeric() || matches!(c, ':' | '_' | '-')))
            .unwrap_or(0)];
        if name.rsplit(':').next() != Some("svg") {
            continue;
        }
        match is_end {
            true => (closed, last) = (closed + 1, Some(at)),
            false => {
                let is_empty = tag.find('>').is_some_and(|end| tag[..end].ends_with('/'));
                opened += usize::from(!is_empty);
            }
        }
    }
    let Some(mut rest) = last.and_then(|at| text[at..].split_once('>')).map(|(_, rest)| rest.trim_start())
    else {
        return false;
    };
    while let Some((_, after)) = rest.strip_prefix("<!--").and_then(|comment| comment.split_once("-->")) {
        rest = after.trim_start();
    }
    opened <= closed && rest.trim_matches('\0').is_empty()
}

/// The text of the file: UTF-8, UTF-16 with a byte order mark, or the encoding that its first line names.
pub(super) fn decoded(bytes: &[u8]) -> Cow<'_, str> {
    if let Some((encoding, _)) = encoding_rs::Encoding::for_bom(bytes) {
        return encoding.decode(bytes).0;
    }
    if let Ok(text) = std::str::from_utf8(bytes) {
        return Cow::Borrowed(text);
    }
    let head = String::from_utf8_lossy(&bytes[..bytes.len().min(200)]);
    let named = head.split_once("encoding=").and_then(|(_, rest)| {
        let quote = rest.chars().next().filter(|quote| matches!(quote, '"' | '\''))?;
        rest[1..].split(quote).next()
    });
    // A head that is cut within a letter is not damaged.
    let encoding = named.and_then(|label| encoding_rs::Encoding::for_label(label.as_bytes()));
    match encoding.filter(|encoding| *encoding != encoding_rs::UTF_8) {
        Some(encoding) => encoding.decode(bytes).0,
        None => String::from_utf8_lossy(bytes),
    }
}

/// Parses the text.
pub(super) fn parsed<'t>(bytes: &[u8], text: &'t str) -> Result<Document<'t>, PatternReadError> {
    if bytes.len() > MAX_BYTES {
        return Err(PatternReadError::FileTooLarge { bytes: bytes.len(), limit: MAX_BYTES });
    }
    check_entities(text)?;
    let nodes_limit = 2 * Cost::Listed.limit() as u32;
    let document = match Document::parse_with_options(
        text,
        ParsingOptions { allow_dtd: true, nodes_limit, ..ParsingOptions::default() },
    ) {
        Ok(document) => document,
        Err(Error::NodesLimitReached | Error::AttributesLimitReached | Error::NamespacesLimitReached) => {
            return Err(PatternReadError::TooMany {
                what: "elements",
                limit: Cost::Listed.limit(),
                entity: None,
            });
        }
        Err(error) => {
            let last = text.lines().count().max(1) as u64;
            let line = u64::from(error.pos().row);
            let is_at_end =
                matches!(error, Error::UnclosedRootNode | Error::UnexpectedEndOfStream) || line >= last;
            return Err(match is_at_end && !is_complete(bytes) {
                true => PatternReadError::SvgTruncated { spot: Spot::Line(last) },
                false => PatternReadError::SvgDamaged { spot: Spot::Line(line), what: error.to_string() },
            });
        }
    };
    check_depth(&document)?;
    let root = document.root_element();
    if root.tag_name().name() != "svg" {
        let what = format!("its outermost element is <{}>, not <svg>", root.tag_name().name());
        return Err(PatternReadError::SvgDamaged { spot: Spot::Line(1), what });
    }
    Ok(document)
}

/// Refuses elements that are nested too deeply to look for their ancestors quickly.
fn check_depth(document: &Document<'_>) -> Result<(), PatternReadError> {
    let mut node = document.root_element();
    let mut depth = 0;
    loop {
        // In document order, with the depth of each element.
        if let Some(child) = node.first_element_child() {
            (node, depth) = (child, depth + 1);
            if depth > MAX_DEPTH {
                let what = "levels of nested elements";
                return Err(PatternReadError::TooMany { what, limit: MAX_DEPTH, entity: None });
            }
            continue;
        }
        loop {
            if depth == 0 {
                return Ok(());
            }
            if let Some(next) = node.next_sibling_element() {
                node = next;
                break;
            }
            match node.parent_element() {
                Some(parent) => (node, depth) = (parent, depth - 1),
                None => return Ok(()),
            }
        }
    }
}

/// Refuses entities that multiply: those that contain others, and long ones that are used often.
fn check_entities(text: &str) -> Result<(), PatternReadError> {
    if !text.contains("<!ENTITY") {
        return Ok(());
    }
    let mut longest = 0;
    let mut line = 1;
    let mut before = 0;
    for (at, _) in text.match_indices("<!ENTITY") {
        line += text[before..at].matches('\n').count() as u64;
        before = at;
        let declaration = &text[at..];
        let Some(quote) = declaration.find(['"', '\'']) else { continue };
        let mark = &declaration[quote..=quote];
        let value = declaration[quote + 1..].split(mark).next().unwrap_or_default();
        longest = longest.max(value.len());
        let has_entity = value.match_indices('&').any(|(at, _)| {
            let name = &value[at + 1..];
            !["#", "amp;", "lt;", "gt;", "quot;", "apos;"].iter().any(|known| name.starts_with(known))
        });
        // A reference to a letter can hide the sign that begins a reference to an entity.
        let is_hidden =
            ["&#38;", "&#x26;", "&#X26;", "&#038;", "&#x0026;"].iter().any(|sign| value.contains(sign));
        if has_entity || is_hidden || value.contains('<') {
            let what = "an entity contains other entities or elements".into();
            return Err(PatternReadError::SvgDamaged { spot: Spot::Line(line), what });
        }
    }
    let uses = text.matches('&').count();
    match uses.saturating_mul(longest) > MAX_REPLACED {
        true => Err(PatternReadError::TooMany {
            what: "bytes in replaced entities",
            limit: MAX_REPLACED,
            entity: None,
        }),
        false => Ok(()),
    }
}

/// Where elements are in the file.
pub(super) struct Lines(Vec<usize>);

impl Lines {
    pub(super) fn of(text: &str) -> Self {
        Self(text.match_indices('\n').map(|(at, _)| at).collect())
    }

    pub(super) fn line(&self, node: Node<'_, '_>) -> u64 {
        self.0.partition_point(|end| *end < node.range().start) as u64 + 1
    }

    /// The `id` of an element, or its line.
    pub(super) fn handle(&self, node: Node<'_, '_>) -> String {
        match attribute(node, "id") {
            Some(id) if !id.trim().is_empty() => id.chars().take(100).collect(),
            _ => format!("in line {}", self.line(node)),
        }
    }

    pub(super) fn name(&self, node: Node<'_, '_>, layer: &str) -> EntityName {
        EntityName {
            kind: node.tag_name().name().into(),
            handle: Some(self.handle(node)),
            layer: layer.into(),
        }
    }
}
