//! What outside code matches on, reads or sets may grow: it is `#[non_exhaustive]`.

use std::path::Path;

use super::{walk, without_comments_and_texts, without_tests};

/// Errors, reports, settings.
const KINDS: &[&str] = &["Error", "Facts", "Options", "Report", "Settings"];
/// Parameters of the mathematics, which have constants in place of defaults and are changed one by one.
const CLOSED: &[&str] = &["IsometricOptions", "MappingDomainOptions"];

/// The public types of these kinds that outside code may take for complete.
fn closed(source: &str) -> Vec<String> {
    let code: String = without_tests(&without_comments_and_texts(source)).iter().collect();
    let mut may_grow = false;
    let mut closed = Vec::new();
    let lines: Vec<&str> = code.lines().map(str::trim).filter(|line| !line.is_empty()).collect();
    // Nobody outside can make or take apart what has a private field.
    let has_private_field = |at: usize| match lines[at].split_once('(') {
        Some((_, fields)) => !fields.starts_with("pub "),
        None => {
            let mut fields =
                lines[at + 1..].iter().take_while(|line| **line != "}").filter(|line| !line.starts_with('#'));
            lines[at].starts_with("pub struct ") && fields.any(|field| !field.starts_with("pub "))
        }
    };
    for (at, line) in lines.iter().copied().enumerate() {
        let item = line.strip_prefix("pub struct ").or_else(|| line.strip_prefix("pub enum "));
        if let Some(item) = item {
            let name = item.split(|c: char| !super::is_word(c)).next().unwrap();
            let is_of_kind = KINDS.iter().any(|kind| name.ends_with(kind)) && !CLOSED.contains(&name);
            closed.extend((is_of_kind && !may_grow && !has_private_field(at)).then(|| name.to_owned()));
        }
        may_grow = line == "#[non_exhaustive]" || (may_grow && line.starts_with("#["));
    }
    closed
}

#[test]
fn errors_reports_and_settings_may_grow() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let found = walk(&root).into_iter().flat_map(|file| {
        let names = closed(&std::fs::read_to_string(&file).unwrap());
        names.into_iter().map(move |name| format!("{}: {name} is not #[non_exhaustive]", file.display()))
    });
    let complaints: Vec<String> = found.collect();
    assert!(complaints.is_empty(), "\n{}\n", complaints.join("\n"));
}

#[test]
fn a_type_that_cannot_grow_is_found() {
    for (source, expected) in [
        ("#[derive(Debug)]\npub enum ReadError {\n}", &["ReadError"][..]),
        ("#[non_exhaustive]\n#[derive(Debug)]\npub enum ReadError {\n}", &[]),
        ("#[non_exhaustive]\npub struct One;\npub struct JobSettings {\n pub a: A,\n}", &["JobSettings"]),
        ("pub struct Settings(Inner);\npub struct LiveSettings {\n file: PathBuf,\n}", &[]),
        ("pub struct FitOptions {\n #[serde(default)]\n pub spans: usize,\n}", &["FitOptions"]),
        ("struct JobSettings;\npub(crate) enum E2Error {}\npub struct Settled;\n// pub enum AnError", &[]),
    ] {
        assert_eq!(closed(source), expected, "{source}");
    }
}
