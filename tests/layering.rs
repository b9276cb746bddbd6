//! Checks the dependencies in the sources: modules, files, crates, the standard library, and calls that end the
//! program.
//!
//! The tables below are the rule. A module may use only modules above it, in the order of `src/lib.rs`, so there are no
//! circular dependencies. Tests inside the sources may use everything.

#![allow(clippy::unwrap_used, reason = "a test may fail loudly, its helpers too")]

use std::path::Path;

use sources::{Modules, Named, is_word, paths, walk, without_comments_and_texts, without_tests};

mod sources;

/// Every module of the crate, in reading order, with the modules that it may use.
const MODULES: &[(&str, &[&str])] = &[
    ("geometry", &[]),
    ("printable", &[]),
    ("reason", &["printable"]),
    ("formats", &["geometry", "printable", "reason"]),
    ("config", &["geometry", "reason", "formats"]),
    ("files", &[]),
    ("cores", &["geometry"]),
    ("converter", &[]),
    ("cache", &["geometry", "formats", "config", "files"]),
    ("preview", &["geometry", "printable", "formats"]),
    ("diff", &["geometry", "printable"]),
    ("report", &["geometry", "printable", "reason", "formats", "cache", "diff"]),
    ("report_html", &["geometry", "reason", "formats", "preview", "report"]),
    (
        "pipeline",
        &[
            "geometry",
            "reason",
            "formats",
            "config",
            "cores",
            "converter",
            "cache",
            "preview",
            "diff",
            "report",
            "report_html",
        ],
    ),
    (
        "front",
        &[
            "geometry",
            "reason",
            "formats",
            "config",
            "files",
            "cache",
            "preview",
            "report",
            "report_html",
            "pipeline",
        ],
    ),
    (
        "hotfolder",
        &[
            "printable",
            "reason",
            "formats",
            "config",
            "files",
            "cache",
            "preview",
            "diff",
            "report",
            "report_html",
            "pipeline",
        ],
    ),
    ("fleet", &["printable", "reason", "config", "files", "cache", "diff", "hotfolder"]),
    (
        "cli",
        &[
            "geometry",
            "printable",
            "reason",
            "formats",
            "config",
            "cores",
            "files",
            "cache",
            "preview",
            "diff",
            "report",
            "report_html",
            "pipeline",
            "hotfolder",
            "fleet",
        ],
    ),
];

/// The modules in which a crate, or a part of the standard library, may be used. Crates that are not listed may be used
/// everywhere except in `geometry`.
const HOMES: &[(&str, &[&str])] = &[
    ("gltf", &["formats"]),
    ("dxf", &["formats"]),
    ("gltf_json", &["formats"]),
    ("tobj", &["formats"]),
    ("draco_core", &["formats"]),
    ("flate2", &["formats"]),
    ("quick_xml", &["formats"]),
    ("image", &["formats"]),
    ("ttf_parser", &["formats"]),
    ("roxmltree", &["formats"]),
    ("svgtypes", &["formats"]),
    ("kurbo", &["formats"]),
    ("encoding_rs", &["formats"]),
    ("i_overlay", &["formats", "geometry"]),
    ("i_triangle", &["geometry"]),
    ("multiversion", &["geometry"]),
    ("spade", &["geometry"]),
    ("oem_cp", &["formats"]),
    ("toml", &["config", "cache"]),
    ("toml_edit", &["config"]),
    ("postcard", &["cache"]),
    ("blake3", &["cache", "pipeline", "hotfolder", "fleet"]),
    ("similar", &["diff"]),
    // For the page in browsers.
    ("hyper", &["hotfolder"]),
    ("tokio", &["hotfolder", "fleet"]),
    ("tokio_postgres", &["fleet"]),
    ("rustls", &["fleet"]),
    ("tokio_rustls", &["fleet"]),
    ("rustls_native_certs", &["fleet"]),
    ("getrandom", &["hotfolder"]),
    ("tempfile", &["files", "converter", "hotfolder"]),
    ("fs_err", &["files", "converter", "config", "cache", "front", "hotfolder", "fleet", "cli"]),
    ("std::fs", &["files", "config", "cache", "hotfolder", "cli"]),
    ("std::time", &["files", "converter", "config", "pipeline", "hotfolder", "fleet", "cli"]),
    // In the command line, only for the line that shows progress.
    ("std::thread", &["files", "cores", "converter", "hotfolder", "fleet", "cli"]),
    ("rayon_core", &["cores"]),
    // In the hot folder, only for the process ID in the lock file; in the fleet, for the name of a run; in the converter, for FreeCAD.
    ("std::process", &["converter", "hotfolder", "fleet", "cli", "main"]),
    // In the hot folder and the fleet, only for the password of the page and of the database; in the converter, to find FreeCAD.
    ("std::env", &["converter", "hotfolder", "fleet", "cli"]),
    // Only for BeamServer, the page and the fleet; in the settings, only for its address.
    ("std::net", &["config", "hotfolder", "fleet"]),
    ("tracing", &["pipeline", "hotfolder", "fleet"]),
    ("tracing_subscriber", &["cli"]),
    ("notify", &["hotfolder"]),
    ("ctrlc", &["cli"]),
    ("unicode_normalization", &["config", "formats"]),
    ("clap", &["cli"]),
    ("annotate_snippets", &["cli"]),
    ("terminal_size", &["cli"]),
    ("strsim", &["config"]),
];

/// Everything that `geometry` may use.
const GEOMETRY_MAY_USE: &[&str] = &[
    "nalgebra",
    "spade",
    "i_overlay",
    "i_triangle",
    // Chooses between versions of a function for processors, with the same results.
    "multiversion",
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
    "std::sync",
];

/// Forbidden outside tests: one bad file must not end the program. `expect` is allowed, because it states an invariant.
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

/// Known circles of files that import each other, still to be removed; a new circle is an error.
const CIRCLES: &[&[&str]] = &[];

#[test]
fn every_module_uses_only_what_it_may() {
    let violations_of = |(file, source): &(String, String)| violations(file, source, &crates());
    let found: Vec<String> = sources().iter().flat_map(violations_of).collect();
    assert!(found.is_empty(), "\n{}\n", found.join("\n"));
}

#[test]
fn the_table_has_the_order_of_the_crate_and_no_circular_dependency() {
    let names: Vec<&str> = MODULES.iter().map(|(name, _)| *name).collect();
    let library = include_str!("../src/lib.rs").lines();
    let declared: Vec<&str> = library
        .filter_map(|line| {
            let line = line.trim_start_matches("pub ");
            // The crate of the mathematics is shown as a module.
            line.strip_prefix("mod ").or(line.strip_prefix("use isomark_geometry as "))?.strip_suffix(';')
        })
        .collect();
    assert_eq!(declared, names, "src/lib.rs and MODULES must list the same modules in the same order");
    for (index, (name, allowed)) in MODULES.iter().enumerate() {
        for used in *allowed {
            assert!(names[..index].contains(used), "{name} may not use {used}: it comes later");
        }
    }
    for (what, homes) in HOMES {
        let external = what.starts_with("std::") || crates().iter().any(|name| name == what);
        assert!(external || *what == "gltf_json", "{what} in HOMES is not a dependency");
        assert!(homes.iter().all(|home| *home == "main" || names.contains(home)), "{what}: unknown home");
    }
}

#[test]
fn no_files_import_each_other_in_a_circle() {
    let mut modules = Modules::default();
    for (file, source) in sources().iter().filter(|(file, _)| file != "src/main.rs") {
        modules.add(file, source);
    }
    let circles = modules.circles();
    let unknown = circles.iter().filter(|circle| !CIRCLES.iter().any(|known| circle.files == *known));
    let arrows = unknown.flat_map(|circle| &circle.arrows);
    let arrows: Vec<String> = arrows.map(|(from, to, names)| format!("{from} -> {to}: {names}")).collect();
    assert!(arrows.is_empty(), "these files import each other:\n{}\n", arrows.join("\n"));
    for known in CIRCLES {
        assert!(
            circles.iter().any(|circle| circle.files == *known),
            "{known:?} is not a circle any more: remove it"
        );
    }
}

#[test]
fn a_circle_is_found_through_re_exports() {
    let circles = |sources: &[(&str, &str)]| {
        let mut modules = Modules::default();
        sources.iter().for_each(|(file, source)| modules.add(file, source));
        let circles = modules.circles().into_iter();
        circles
            .map(|circle| {
                circle.arrows.iter().map(|(from, to, names)| format!("{from} {to} {names}")).collect()
            })
            .collect::<Vec<Vec<String>>>()
    };
    let (root, none) = (("src/lib.rs", "pub mod a; pub mod b;"), Vec::<Vec<String>>::new());
    let b = ("src/b/mod.rs", "mod c; mod d; pub use c::C; pub(crate) use self::d::D as E; pub struct B;");
    let found = |a, c, d| circles(&[root, ("src/a.rs", a), b, ("src/b/c.rs", c), ("src/b/d.rs", d)]);
    // Directly, and through the file that re-exports C.
    let straight = ["src/a.rs src/b/c.rs C", "src/b/c.rs src/a.rs A"];
    assert_eq!(found("use crate::b::C;", "use crate::a::A;", ""), [straight]);
    // With a new name, in a group, in a path without `use`, and over three files.
    let round = ["src/a.rs src/b/d.rs E", "src/b/c.rs src/a.rs x", "src/b/d.rs src/b/c.rs K"];
    assert_eq!(
        found(
            "use super::b::{B, E as F};",
            "fn f() { crate::a::x() }",
            "use super::c as k; fn g() -> k::K {}"
        ),
        [round]
    );
    // A module that uses its submodule, which uses the module.
    let parent = [("src/a.rs", "mod p; use p::P;"), ("src/a/p.rs", "use super::A;")];
    assert_eq!(circles(&parent), [["src/a.rs src/a/p.rs P", "src/a/p.rs src/a.rs A"]]);
    // One direction, re-exports, tests, comments, and names of other crates are not circles.
    assert_eq!(
        found("use crate::b::{B, C};", "use super::B;", "use toml::toml; use super::super::b::B;"),
        none
    );
    let a = "// crate::b::C\n#[cfg(test)]\nmod tests { use crate::b::C; }";
    assert_eq!(found(a, "use crate::a::A;", "const C: &str = \"crate::a::A\";"), none);
}

#[test]
fn a_violation_is_reported_with_its_line_and_rule() {
    for (file, source, expected) in [
        ("src/geometry/x.rs", "\nuse std::{f64, fs};", "src/geometry/x.rs:2: geometry uses std::fs"),
        ("src/geometry/x.rs", "use serde::Serialize;", "src/geometry/x.rs:1: geometry uses serde"),
        ("src/geometry/a/b.rs", "use super::super::super::reason::Reason;", "geometry uses reason"),
        ("src/formats/x.rs", "use crate::{geometry::mesh, config::{Sku}};", "formats uses config"),
        ("src/report.rs", "fn f() { super::hotfolder::run() }", "report uses hotfolder"),
        ("src/pipeline.rs", "fn f() -> gltf::Gltf", "pipeline uses gltf"),
        ("src/config/x.rs", "use notify as n;", "config uses notify"),
        ("src/diff/x.rs", "\n\nx.unwrap()", "src/diff/x.rs:3: `.unwrap()`"),
        ("src/cli/x.rs", "let a = '\"'; todo!()", "`todo!`"),
    ] {
        let found = violations(file, source, &crates());
        assert!(found.len() == 1 && found[0].contains(expected), "{source}: {found:?}");
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
        assert_eq!(violations(file, source, &crates()), [""; 0], "{source}");
    }
}

/// Path and text of every file of the crate except tests.
fn sources() -> Vec<(String, String)> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let files = walk(&root.join("src")).into_iter().map(|entry| {
        let file = entry.strip_prefix(root).unwrap().to_str().unwrap().replace('\\', "/");
        (file, std::fs::read_to_string(&entry).unwrap())
    });
    files.filter(|(file, _)| !file.ends_with("tests.rs")).collect()
}

/// The dependencies of both crates, by their names in the sources.
fn crates() -> Vec<String> {
    let names = |manifest: &'static str| {
        let table = manifest.split("\n[").find(|table| table.starts_with("dependencies]"));
        let lines = table.unwrap().lines().filter(|line| !line.starts_with('#'));
        lines.filter_map(|line| {
            Some(line.split_once(" =")?.0.trim_end_matches(".workspace").replace('-', "_"))
        })
    };
    names(include_str!("../Cargo.toml")).chain(names(include_str!("../src/geometry/Cargo.toml"))).collect()
}

/// All violations in one file, one line each.
fn violations(file: &str, source: &str, crates: &[String]) -> Vec<String> {
    let parts: Vec<&str> = file.trim_start_matches("src/").trim_end_matches(".rs").split('/').collect();
    let module = parts[0];
    // The number of `super` from this file to the root of the crate.
    let depth = parts.len() - usize::from(parts.last() == Some(&"mod"));
    let allowed = MODULES.iter().find(|(name, _)| *name == module).map(|(_, allowed)| *allowed);
    let code = without_tests(&without_comments_and_texts(source));
    let text: String = code.iter().collect();
    let mut violations = Vec::new();
    let mut report = |at: usize, what: String| {
        let line = code[..at].iter().filter(|&&c| c == '\n').count() + 1;
        violations.push(format!("{file}:{line}: {what} (tests/layering.rs)"));
    };
    for word in FORBIDDEN {
        for (byte, _) in text.match_indices(word) {
            let before = text[..byte].chars().next_back();
            if word.starts_with('.') || !before.is_some_and(is_word) {
                report(text[..byte].chars().count(), format!("`{word}` is allowed only in tests"));
            }
        }
    }
    for Named { at, steps: path, .. } in paths(&code) {
        let supers = path.iter().take_while(|step| *step == "super").count();
        let inner = match path[0].as_str() {
            "crate" | "isomark" => path.get(1),
            "super" if supers >= depth => path.get(supers),
            _ => None,
        };
        if let (Some(used), Some(allowed)) = (inner, allowed) {
            let is_module = MODULES.iter().any(|(name, _)| name == used);
            if is_module && used != module && !allowed.contains(&used.as_str()) {
                report(at, format!("{module} uses {used}, but may use only [{}]", allowed.join(", ")));
            }
        }
        let external = match path[0].as_str() {
            "std" | "core" => format!("std::{}", path.get(1).map_or("", String::as_str)),
            name if crates.iter().any(|known| known == name) => name.to_owned(),
            _ => continue,
        };
        let homes = HOMES.iter().find(|(name, _)| *name == external).map(|(_, homes)| *homes);
        if module == "geometry" && !GEOMETRY_MAY_USE.contains(&external.as_str()) {
            report(
                at,
                format!("geometry uses {external}, but may use only [{}]", GEOMETRY_MAY_USE.join(", ")),
            );
        } else if let Some(homes) = homes.filter(|homes| !homes.contains(&module)) {
            report(at, format!("{module} uses {external}, which is allowed only in [{}]", homes.join(", ")));
        }
    }
    violations
}
