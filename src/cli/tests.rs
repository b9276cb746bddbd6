//! Files of this repository that are made from the sources. `cargo test --lib write_generated_files -- --ignored` writes
//! them again.

use std::path::Path;

use fs_err as fs;

use crate::reason::{Code, CodeKind};

const COMMAND: &str = "cargo test --lib write_generated_files -- --ignored";

/// Each file with its content.
fn generated() -> Vec<(String, String)> {
    vec![("plugins/codes.md".into(), codes())]
}

/// The codes as a page.
fn codes() -> String {
    let mut page = format!(
        "# Codes of reasons and notices\n\n\
         Every reason and every notice has a code. Codes are stable, and made for programs; the sentences are for people and\n\
         may change. `isomark explain CODE` prints an entry of this page, `isomark explain --json` all of them.\n\n\
         <!-- Made from src/reason/codes.rs by `{COMMAND}`. -->\n"
    );
    for kind in CodeKind::ALL {
        page += &format!("\n## {}\n", kind.title());
        for Code { code, meaning, explanation, remedy, .. } in
            Code::ALL.iter().filter(|code| code.kind == *kind)
        {
            let [meaning, explanation, remedy] = [meaning, explanation, remedy].map(|text| plain(text));
            page += &format!("\n### {code}\n\n**{meaning}** {explanation}\n\n*What to do:* {remedy}\n");
        }
    }
    page
}

/// Text in which nothing is markup but what is between backticks.
fn plain(text: &str) -> String {
    let pieces = text.split('`').enumerate().map(|(index, piece)| match index % 2 {
        0 => piece
            .replace('\\', "\\\\")
            .replace('<', "&lt;")
            .replace('*', "\\*")
            .replace('|', "\\|")
            .replace('[', "\\["),
        _ => piece.to_owned(),
    });
    pieces.collect::<Vec<_>>().join("`")
}

#[test]
fn the_generated_files_are_those_of_the_sources() {
    for (file, content) in generated() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(&file);
        // A checkout on Windows may have other line ends.
        let kept = fs::read_to_string(path).unwrap_or_default().replace("\r\n", "\n");
        assert!(kept == content, "{file} is out of date: run `{COMMAND}` and look at the difference");
    }
}

#[test]
#[ignore = "writes the generated files"]
fn write_generated_files() {
    for (file, content) in generated() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(&file);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, content).unwrap();
    }
}
