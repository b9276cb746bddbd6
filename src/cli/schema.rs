//! `isomark schema`: the JSON Schemas of all documents, for programs that read them.

use clap::Args;

use super::outcome::{Failure, Outcome, print, print_json};
use crate::config::near;

/// A kind of document with its schema; `cli/tests.rs` makes the files from the types.
pub(super) struct Document {
    /// Its name, and that of its schema's file.
    pub(super) name: &'static str,
    /// What it is, in a few words.
    about: &'static str,
    /// Its JSON Schema.
    schema: &'static str,
}

macro_rules! documents {
    ($($name:literal: $about:literal,)+) => {
        /// All kinds of documents.
        pub(super) const DOCUMENTS: &[Document] = &[$(Document {
            name: $name,
            about: $about,
            schema: include_str!(concat!("../../plugins/schemas/", $name, ".schema.json")),
        }),+];
    };
}

documents! {
    "report": "a corrected drawing: what was read, decided and measured",
    "reason": "why an input was rejected, or why a command failed",
    "part": "what a part file contains and what was assumed",
    "pattern": "what a drawing contains and what was assumed",
    "evaluate": "every method for one drawing on one part",
    "diff": "what changed between two drawings",
    "status": "the state of a station",
    "fleet": "the stations of a fleet",
    "releases": "the versions of the settings of a SKU in a fleet",
    "sent": "drawings that were sent to a line of a fleet",
    "lens": "a measured lens",
    "registration": "where a part stands under the laser",
    "rotary": "the tiles of a mark round the part, with the angles of the rotary axis",
    "list": "the products of a list, each with its serial number and its drawing",
    "plan": "how long a drawing takes on a belt, and how fast the belt may move",
    "codes": "codes of reasons and notices, explained",
}

#[derive(Debug, Args)]
pub(super) struct SchemaArguments {
    /// The document, such as `report`; without it, all documents are listed.
    name: Option<String>,
}

pub(super) fn run(arguments: &SchemaArguments) -> Outcome {
    let Some(given) = &arguments.name else {
        for Document { name, about, .. } in DOCUMENTS {
            print(&format!("{name:<9} isomark.{name}/1   {about}\n"));
        }
        return Ok(());
    };
    // The name that a document gives in its own field `schema` is as good.
    let name = given.strip_prefix("isomark.").unwrap_or(given);
    let name = name.strip_suffix("/1").unwrap_or(name);
    let known = DOCUMENTS.iter().find(|document| document.name == name);
    let document = known.ok_or_else(|| {
        let names: Vec<&str> = DOCUMENTS.iter().map(|document| document.name).collect();
        let remedy = match near(name, &names).first() {
            Some(near) => format!("Did you mean `{near}`? Known are {}.", names.join(", ")),
            None => format!("Known are {}.", names.join(", ")),
        };
        Failure::usage(format!("There is no document `{given}`."), remedy)
    })?;
    print_json(document.schema);
    Ok(())
}
