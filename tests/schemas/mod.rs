//! The schemas of `plugins/schemas`, which every JSON document of the tests is held against.

#![allow(unreachable_pub, reason = "a module of tests")]

use std::collections::BTreeMap;
use std::path::Path;

use boon::{Compiler, SchemaIndex, Schemas};
use fs_err as fs;
use serde_json::Value;

thread_local! {
    static KNOWN: Known = Known::new();
}

/// The schemas by the names that documents give in their field `schema`.
struct Known {
    schemas: Schemas,
    by_name: BTreeMap<String, SchemaIndex>,
}

impl Known {
    fn new() -> Self {
        let (mut schemas, mut compiler) = (Schemas::new(), Compiler::new());
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("plugins/schemas");
        let by_name = fs::read_dir(folder).unwrap().map(|entry| {
            let path = entry.unwrap().path();
            let schema: Value = serde_json::from_slice(&fs::read(&path).unwrap()).unwrap();
            let name = schema["title"].as_str().unwrap().to_owned();
            let place = format!("https://isomark.example/{name}");
            compiler.add_resource(&place, schema).unwrap();
            (name, compiler.compile(&place, &mut schemas).unwrap_or_else(|error| panic!("{error:#}")))
        });
        let by_name = by_name.collect();
        Self { schemas, by_name }
    }
}

/// What is wrong with a document, by the schema that it names.
pub fn mistake(document: &Value) -> Option<String> {
    KNOWN.with(|Known { schemas, by_name }| {
        let name = document["schema"].as_str().unwrap_or_default();
        let Some(index) = by_name.get(name) else { return Some(format!("no schema for {name:?}")) };
        schemas.validate(document, *index).err().map(|error| format!("{error:#}"))
    })
}

/// Reads a document, which has to be valid.
#[track_caller]
pub fn document(text: impl AsRef<[u8]>) -> Value {
    let text = text.as_ref();
    let document = serde_json::from_slice(text);
    let document = document.unwrap_or_else(|error| panic!("{error} in {}", String::from_utf8_lossy(text)));
    if let Some(mistake) = mistake(&document) {
        panic!("{mistake}\nin {document:#}");
    }
    document
}

/// Whether a file of a station is a document with a schema.
pub fn is_document(path: &Path) -> bool {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let is_in_state = path.parent().is_some_and(|folder| folder.ends_with("state"));
    [".report.json", ".reason.json", ".list.json"].iter().any(|ending| name.ends_with(ending))
        || (name == "status.json" && is_in_state)
}

/// Checks every document that a station left below a folder, unless the test has failed already.
pub fn check_below(folder: &Path) {
    if std::thread::panicking() {
        return;
    }
    let Ok(entries) = fs::read_dir(folder) else { return };
    for path in entries.filter_map(|entry| Some(entry.ok()?.path())) {
        if path.is_dir() && !path.is_symlink() {
            check_below(&path);
        } else if is_document(&path)
            && let Ok(text) = fs::read(&path)
        {
            document(text);
        }
    }
}
