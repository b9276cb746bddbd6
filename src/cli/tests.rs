//! Files of this repository that are made from the sources. `cargo test --lib write_generated_files -- --ignored` writes
//! them again.

use std::path::Path;

use fs_err as fs;
use schemars::generate::SchemaSettings;
use schemars::{JsonSchema, SchemaGenerator};
use serde_json::{Value, json};

use super::{calibrate, diff, explain, register, schema};
use crate::formats::mesh::PartFacts;
use crate::formats::pattern::PatternFacts;
use crate::hotfolder::status::Status;
use crate::pipeline::Evaluation;
use crate::reason::{Code, CodeKind, ReasonFile};
use crate::report::{ListReport, Report, RotaryTable};

const COMMAND: &str = "cargo test --lib write_generated_files -- --ignored";

/// Each file with its content.
fn generated() -> Vec<(String, String)> {
    let schemas = schema::DOCUMENTS.iter().map(|document| {
        let schema = serde_json::to_string_pretty(&schema_of(document.name)).unwrap();
        (format!("plugins/schemas/{}.schema.json", document.name), schema + "\n")
    });
    schemas.chain([("plugins/codes.md".into(), codes())]).collect()
}

/// The schema of a document, from its type.
fn schema_of(name: &str) -> Value {
    match name {
        "report" => document::<Report>(name),
        "reason" => document::<ReasonFile<'_>>(name),
        "part" => document::<PartFacts>(name),
        "pattern" => document::<PatternFacts>(name),
        "evaluate" => document::<Evaluation>(name),
        "diff" => document::<diff::Document<'_>>(name),
        "status" => document::<Status>(name),
        "fleet" => document::<crate::fleet::FleetStatus>(name),
        "releases" => document::<crate::fleet::Releases>(name),
        "sent" => document::<super::send::SentDocument>(name),
        "registration" => document::<register::RegistrationDocument>(name),
        "lens" => document::<calibrate::LensDocument>(name),
        "rotary" => document::<RotaryTable>(name),
        "list" => document::<ListReport>(name),
        "plan" => document::<super::plan::Document>(name),
        "codes" => document::<explain::Document>(name),
        _ => panic!("no type makes the document {name}"),
    }
}

/// What is written is described, so that a field which is always there is required.
fn document<T: JsonSchema>(name: &str) -> Value {
    let generator = SchemaGenerator::new(SchemaSettings::draft2020_12().for_serialize());
    let mut schema = generator.into_root_schema_for::<T>().to_value();
    let name = format!("isomark.{name}/1");
    without_links(&mut schema);
    schema["title"] = name.as_str().into();
    schema["properties"]["schema"] =
        json!({ "description": "Name and version of this form.", "const": name });
    let required = schema["required"].as_array_mut().unwrap();
    required.retain(|field| field != "schema");
    required.insert(0, "schema".into());
    schema
}

/// Takes the links of Rust's documentation out of the descriptions.
fn without_links(schema: &mut Value) {
    match schema {
        Value::Object(fields) => fields.iter_mut().for_each(|(key, value)| match value {
            Value::String(text) if key == "description" => {
                *text = text.replace("[`", "`").replace("`]", "`").replace('\n', " ");
            }
            _ => without_links(value),
        }),
        Value::Array(items) => items.iter_mut().for_each(without_links),
        _ => {}
    }
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

#[test]
fn every_document_is_in_the_table_for_integrators() {
    let table = include_str!("../../plugins/README.md");
    for schema::Document { name, .. } in schema::DOCUMENTS {
        let row = table.lines().find(|line| line.starts_with(&format!("| `isomark.{name}/1` |")));
        let link = format!("| [`{name}`](schemas/{name}.schema.json) |");
        assert!(row.is_some_and(|row| row.ends_with(&link)), "{name}");
    }
}
