//! Who may know whom, held against the sources: modules, crates, the standard library, and words that end a program.
//!
//! The tables below are the rule. A module may know only modules above it, in the order of `src/lib.rs`, so no arrow
//! leads back. Tests inside the sources may know everything.

#![allow(clippy::unwrap_used, reason = "a test may fail loudly, its helpers too")]

use std::path::Path;

/// Every module of the crate, in reading order, with the modules it may know.
const MODULES: &[(&str, &[&str])] = &[
    ("geometry", &[]),
    ("printable", &[]),
    ("reason", &["printable"]),
    ("formats", &["geometry", "printable", "reason"]),
    ("config", &["geometry", "reason", "formats"]),
    ("files", &[]),
    ("cache", &["geometry", "formats", "config", "files"]),
    ("preview", &["geometry", "printable"]),
    ("diff", &["geometry", "printable"]),
    ("report", &["geometry", "printable", "reason", "formats", "cache", "diff"]),
    ("pipeline", &["geometry", "reason", "formats", "config", "cache", "preview", "diff", "report"]),
    (
        "hotfolder",
        &["printable", "reason", "formats", "config", "files", "cache", "preview", "diff", "pipeline"],
    ),
    (
        "cli",
        &[
            "geometry",
            "printable",
            "reason",
            "formats",
            "config",
            "files",
            "cache",
            "preview",
            "diff",
            "report",
            "pipeline",
            "hotfolder",
        ],
    ),
];

/// Where a crate, or a part of the standard library, may be named. What is not listed may be named everywhere but in
/// `geometry`.
const HOMES: &[(&str, &[&str])] = &[
    ("gltf", &["formats"]),
    ("dxf", &["formats"]),
    ("gltf_json", &["formats"]),
    ("tobj", &["formats"]),
    ("image", &["formats"]),
    ("ttf_parser", &["formats"]),
    ("encoding_rs", &["formats"]),
    ("i_overlay", &["formats"]),
    ("oem_cp", &["formats"]),
    ("faer", &["geometry"]),
    ("toml", &["config", "cache"]),
    ("postcard", &["cache"]),
    ("blake3", &["cache", "pipeline", "hotfolder"]),
    ("similar", &["diff"]),
    ("tempfile", &["files", "hotfolder"]),
    ("fs_err", &["files", "config", "cache", "hotfolder", "cli"]),
    ("std::fs", &["files", "config", "cache", "hotfolder", "cli"]),
    ("std::time", &["files", "config", "pipeline", "hotfolder", "cli"]),
    ("std::thread", &["hotfolder"]),
    // Only its own number, which the lock tells others.
    ("std::process", &["hotfolder", "cli", "main"]),
    ("std::env", &["cli"]),
    // BeamServer is the only one that is talked to.
    ("std::net", &["hotfolder"]),
    ("tracing", &["pipeline", "hotfolder"]),
    ("tracing_subscriber", &["cli"]),
    ("notify", &["hotfolder"]),
    ("ctrlc", &["cli"]),
    ("unicode_normalization", &["config"]),
    ("clap", &["cli"]),
];

/// All that mathematics needs.
const GEOMETRY_KNOWS: &[&str] = &[
    "nalgebra",
    "faer",
    "thiserror",
    "std::array",
    "std::cmp",
    "std::collections",
    "std::f64",
    "std::fmt",
    "std::iter",
    "std::marker",
    "std::mem",
    "std::ops",
    "std::slice",
];

/// What no code outside tests says: one bad file must not end the night's work. `expect` states an invariant.
const FORBIDDEN: &[&str] = &[
    ".unwrap()",
    "panic!",
    "todo!",
    "unimplemented!",
    "dbg!",
    "print!",
    "println!",
    "eprint!",
    "eprintln!",
    "process::exit",
    "process::abort",
];

#[test]
fn every_module_knows_only_what_it_may() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut complaints = Vec::new();
    for entry in walk(&root.join("src")) {
        let file = entry.strip_prefix(root).unwrap().to_str().unwrap().replace('\\', "/");
        if !file.ends_with("tests.rs") {
            complaints.extend(judge(&file, &std::fs::read_to_string(&entry).unwrap(), &crates()));
        }
    }
    assert!(complaints.is_empty(), "\n{}\n", complaints.join("\n"));
}

#[test]
fn the_table_has_the_order_of_the_crate_and_no_arrow_back() {
    let names: Vec<&str> = MODULES.iter().map(|(name, _)| *name).collect();
    let library = include_str!("../src/lib.rs").lines();
    let declared: Vec<&str> =
        library.filter_map(|line| line.strip_prefix("pub mod ")?.strip_suffix(';')).collect();
    assert_eq!(declared, names, "src/lib.rs and MODULES name the same modules in the same order");
    for (index, (name, knows)) in MODULES.iter().enumerate() {
        for known in *knows {
            assert!(names[..index].contains(known), "{name} may not know {known}: it comes later");
        }
    }
    for (what, homes) in HOMES {
        let external = what.starts_with("std::") || crates().iter().any(|name| name == what);
        assert!(external || *what == "gltf_json", "{what} in HOMES is no dependency");
        assert!(homes.iter().all(|home| *home == "main" || names.contains(home)), "{what}: unknown home");
    }
}

#[test]
fn a_trespass_is_named_with_its_line_and_its_rule() {
    for (file, source, words) in [
        ("src/geometry/x.rs", "\nuse std::{f64, fs};", "src/geometry/x.rs:2: geometry names std::fs"),
        ("src/geometry/x.rs", "use serde::Serialize;", "src/geometry/x.rs:1: geometry names serde"),
        ("src/geometry/a/b.rs", "use super::super::super::reason::Reason;", "geometry knows reason"),
        ("src/formats/x.rs", "use crate::{geometry::mesh, config::{Sku}};", "formats knows config"),
        ("src/report.rs", "fn f() { super::hotfolder::run() }", "report knows hotfolder"),
        ("src/pipeline.rs", "fn f() -> gltf::Gltf", "pipeline names gltf"),
        ("src/config/x.rs", "use notify as n;", "config names notify"),
        ("src/diff/x.rs", "\n\nx.unwrap()", "src/diff/x.rs:3: `.unwrap()`"),
        ("src/cli/x.rs", "let a = '\"'; todo!()", "`todo!`"),
    ] {
        let complaints = judge(file, source, &crates());
        assert!(complaints.len() == 1 && complaints[0].contains(words), "{source}: {complaints:?}");
    }
    for (file, source) in [
        ("src/geometry/x.rs", "// serde::x\n/* std::fs */ const A: &str = \"std::fs::read\"; use super::b;"),
        (
            "src/geometry/x.rs",
            "fn f<'a>() {}\n#[cfg(test)]\nmod tests { fn g() { std::fs::read(\"}\").unwrap() } }",
        ),
        ("src/formats/a/b.rs", "use super::super::a; use self::dxf::read; r#\"panic!\"#;"),
        ("src/cache.rs", "use crate::config::Sku; fn f() { x.unwrap_or(1) }"),
    ] {
        assert_eq!(judge(file, source, &crates()), [""; 0], "{source}");
    }
}

fn walk(folder: &Path) -> Vec<std::path::PathBuf> {
    let mut entries: Vec<_> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    entries.sort();
    let nested = entries.into_iter().flat_map(|path| if path.is_dir() { walk(&path) } else { vec![path] });
    nested.filter(|path| path.extension().is_some_and(|ending| ending == "rs")).collect()
}

/// The names that the dependencies of `Cargo.toml` have in the sources.
fn crates() -> Vec<String> {
    let manifest =
        include_str!("../Cargo.toml").split("\n[").find(|table| table.starts_with("dependencies]"));
    let lines = manifest.unwrap().lines().filter(|line| !line.starts_with('#'));
    lines.filter_map(|line| Some(line.split_once(" =")?.0.replace('-', "_"))).collect()
}

/// Everything that one file may not say, a line each.
fn judge(file: &str, source: &str, crates: &[String]) -> Vec<String> {
    let parts: Vec<&str> = file.trim_start_matches("src/").trim_end_matches(".rs").split('/').collect();
    let module = parts[0];
    // How many `super` lead from this file to the root of the crate.
    let depth = parts.len() - usize::from(parts.last() == Some(&"mod"));
    let knows = MODULES.iter().find(|(name, _)| *name == module).map(|(_, knows)| *knows);
    let code = without_tests(&without_comments_and_texts(source));
    let text: String = code.iter().collect();
    let mut complaints = Vec::new();
    let mut complain = |at: usize, words: String| {
        let line = code[..at].iter().filter(|&&c| c == '\n').count() + 1;
        complaints.push(format!("{file}:{line}: {words} (tests/layering.rs)"));
    };
    for word in FORBIDDEN {
        for (byte, _) in text.match_indices(word) {
            let before = text[..byte].chars().next_back();
            if word.starts_with('.') || !before.is_some_and(is_word) {
                complain(text[..byte].chars().count(), format!("`{word}` is only for tests"));
            }
        }
    }
    for (at, path) in paths(&code) {
        let supers = path.iter().take_while(|step| *step == "super").count();
        let inner = match path[0].as_str() {
            "crate" | "isomark" => path.get(1),
            "super" if supers >= depth => path.get(supers),
            _ => None,
        };
        if let (Some(known), Some(knows)) = (inner, knows) {
            let is_module = MODULES.iter().any(|(name, _)| name == known);
            if is_module && known != module && !knows.contains(&known.as_str()) {
                complain(at, format!("{module} knows {known}, but may know only [{}]", knows.join(", ")));
            }
        }
        let external = match path[0].as_str() {
            "std" | "core" => format!("std::{}", path.get(1).map_or("", String::as_str)),
            name if crates.iter().any(|known| known == name) => name.to_owned(),
            _ => continue,
        };
        let homes = HOMES.iter().find(|(name, _)| *name == external).map(|(_, homes)| *homes);
        if module == "geometry" && !GEOMETRY_KNOWS.contains(&external.as_str()) {
            complain(
                at,
                format!("geometry names {external}; it may name only [{}]", GEOMETRY_KNOWS.join(", ")),
            );
        } else if let Some(homes) = homes.filter(|homes| !homes.contains(&module)) {
            complain(at, format!("{module} names {external}, which only [{}] may", homes.join(", ")));
        }
    }
    complaints
}

fn is_word(c: char) -> bool {
    c.is_alphanumeric() || c == '_'
}

/// The source with blanks for comments, texts and characters; lines stay where they are.
fn without_comments_and_texts(source: &str) -> Vec<char> {
    let source: Vec<char> = source.chars().collect();
    let at = |index: usize| source.get(index).copied().unwrap_or('\0');
    let mut code = Vec::with_capacity(source.len());
    let mut index = 0;
    while index < source.len() {
        let after_word = index > 0 && is_word(at(index - 1));
        let hashes = (index + 1..).take_while(|&next| at(next) == '#').count();
        let end = match at(index) {
            '/' if at(index + 1) == '/' => (index..).find(|&next| matches!(at(next), '\n' | '\0')).unwrap(),
            '/' if at(index + 1) == '*' => {
                let mut open = 0;
                let mut next = index;
                loop {
                    match (at(next), at(next + 1)) {
                        ('/', '*') => (open, next) = (open + 1, next + 2),
                        ('*', '/') => (open, next) = (open - 1, next + 2),
                        ('\0', _) => break next,
                        _ => next += 1,
                    }
                    if open == 0 {
                        break next;
                    }
                }
            }
            'r' if (!after_word || at(index - 1) == 'b') && at(index + 1 + hashes) == '"' => {
                let closes = |next: usize| at(next) == '"' && (1..=hashes).all(|hash| at(next + hash) == '#');
                let first = index + hashes + 2;
                (first..).find(|&next| closes(next) || next >= source.len()).unwrap() + hashes + 1
            }
            '"' => {
                let mut next = index + 1;
                while !matches!(at(next), '"' | '\0') {
                    next += if at(next) == '\\' { 2 } else { 1 };
                }
                next + 1
            }
            '\'' if at(index + 1) == '\\' => {
                (index + 3..).find(|&next| matches!(at(next), '\'' | '\0')).unwrap() + 1
            }
            '\'' if at(index + 2) == '\'' => index + 3,
            _ => {
                code.push(at(index));
                index += 1;
                continue;
            }
        };
        let end = end.min(source.len());
        code.extend(source[index..end].iter().map(|&c| if c == '\n' { '\n' } else { ' ' }));
        index = end;
    }
    code
}

/// The code with blanks for every item that is compiled for tests only.
fn without_tests(code: &[char]) -> Vec<char> {
    let mut code = code.to_vec();
    let attribute: Vec<char> = "#[cfg(test)]".chars().collect();
    let mut index = 0;
    while index + attribute.len() <= code.len() {
        if code[index..index + attribute.len()] != attribute[..] {
            index += 1;
            continue;
        }
        let mut end = index + attribute.len();
        let mut open = 0;
        while end < code.len() {
            match code[end] {
                '{' => open += 1,
                '}' => open -= 1,
                _ => {}
            }
            end += 1;
            if open == 0 && matches!(code[end - 1], '}' | ';') {
                break;
            }
        }
        code[index..end].iter_mut().filter(|c| **c != '\n').for_each(|c| *c = ' ');
        index = end;
    }
    code
}

/// Every path with more than one step, and every name behind a `use`, with the groups of a `use` spelled out.
fn paths(code: &[char]) -> Vec<(usize, Vec<String>)> {
    let mut paths = Vec::new();
    let mut index = 0;
    let mut behind_use = false;
    while index < code.len() {
        if !is_word(code[index]) {
            index += 1;
            continue;
        }
        let is_inner = code[..index].iter().rev().find(|c| !c.is_whitespace()).is_some_and(|c| *c == '.');
        let mut found = Vec::new();
        index = read_path(code, index, &[], &mut found);
        let word = found.first().map_or("", |(_, path): &(usize, Vec<String>)| path[0].as_str()).to_owned();
        if !is_inner {
            paths.extend(found.into_iter().filter(|(_, path)| path.len() > 1 || behind_use));
        }
        behind_use = word == "use";
    }
    paths
}

/// Reads one path from a word on, adds it (or, for a group, each of its members) and returns where it ends.
fn read_path(code: &[char], start: usize, before: &[String], found: &mut Vec<(usize, Vec<String>)>) -> usize {
    let skip = |from: usize| (from..code.len()).find(|&at| !code[at].is_whitespace()).unwrap_or(code.len());
    let end = (start..code.len()).find(|&at| !is_word(code[at])).unwrap_or(code.len());
    let mut path = before.to_vec();
    path.push(code[start..end].iter().collect());
    let colons = skip(end);
    if code.get(colons..colons + 2) != Some(&[':', ':']) {
        found.push((start, path));
        return end;
    }
    let next = skip(colons + 2);
    match code.get(next) {
        Some('{') => {
            let mut at = next + 1;
            while at < code.len() && code[at] != '}' {
                at = if is_word(code[at]) { read_path(code, at, &path, found) } else { at + 1 };
            }
            at + 1
        }
        Some(&c) if is_word(c) => read_path(code, next, &path, found),
        _ => {
            found.push((start, path));
            next
        }
    }
}
