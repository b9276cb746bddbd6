//! A client of BeamServer: imports a drawing into BeamConstruct, checks that it has its true size, and removes the
//! older drawing of the same name. It has no command that starts marking: a person decides that.
//!
//! BeamServer (OpenAPC manual, 7.10) accepts one ASCII command per line over TCP and answers with one line: `OK`, the
//! requested value, or `ERROR a b` with two numbers. It serves one client at a time, so each delivery opens a
//! connection and closes it again.
//!
//! | step | commands |
//! |---|---|
//! | list the elements | `CmdListName n`, `CmdListUID n` for n = 0, 1 … until an error |
//! | import the drawing | `CmdImport <path>` |
//! | find its element | the list again: a new element with this name |
//! | read its size | `CmdSelEntName \<name>`, `CmdGetSizeX`, `CmdGetSizeY`, in 1/10000 mm |
//! | remove it, or an older one | `CmdDeleteEnt <id>` |
//!
//! Elements are selected by name alone, so the size of a drawing cannot be read while an older one with the same name
//! exists. Therefore a drawing that replaces another is imported twice: first as a trial under a separate name, and
//! then, if its size is correct, in place of the older one. A drawing with a wrong size is removed, so that it cannot
//! be marked.

mod client;
mod gate;

use std::path::Path;

use super::api::JobError;
use super::seen::StopSignal;
use crate::config::DeliverySettings;
use crate::reason::Reason;

use client::{Server, SessionError};
pub(super) use gate::Gate;

/// A drawing in the import folder that is to be imported into BeamConstruct.
pub(crate) struct Drawing<'a> {
    /// The name of its file and of its element.
    pub(crate) name: &'a str,
    /// Its path on the server.
    pub(crate) path: String,
    /// Width and height, mm, if they are known.
    pub(crate) size: Option<[f64; 2]>,
    /// Name and path of its copy for the trial import.
    pub(crate) trial: (&'a str, String),
    /// It was imported before: nothing is left to do if it is still there.
    pub(crate) is_known: bool,
}

/// A path that can be sent to BeamServer.
///
/// # Errors
/// Rejects a path that is not ASCII.
pub(crate) fn sendable(path: &Path) -> Result<String, JobError> {
    let ascii = path.to_str().filter(|path| path.is_ascii() && !path.contains(['\r', '\n']));
    ascii.map(str::to_owned).ok_or_else(|| {
        let what = format!("BeamServer accepts only ASCII paths, and {} is not ASCII.", path.display());
        let remedy = "Use only plain letters and digits in the names of SKU, drawing and folder.";
        JobError::Rejected(Reason::new("beamserver-path", what, remedy))
    })
}

/// Imports the drawing under its name; returns what was done, as text for the log. `lay_out` writes the copy for the
/// trial import.
pub(crate) fn import(
    delivery: &DeliverySettings,
    drawing: &Drawing<'_>,
    stop: &StopSignal,
    lay_out: impl FnOnce() -> Result<(), JobError>,
) -> Result<String, SessionError> {
    let mut server = Server::connect(delivery, stop)?;
    let name = drawing.name;
    let (trial, trial_path) = &drawing.trial;
    let before = server.elements(name)?;
    if drawing.is_known && before.len() == 1 {
        return Ok("is already in BeamConstruct".into());
    }
    // An interruption may have left a trial element.
    server.elements(trial)?.iter().try_for_each(|left| server.delete(left))?;
    if let Some(size) = drawing.size.filter(|_| !before.is_empty()) {
        lay_out()?;
        let tried = server.import_new(trial, trial_path, &[])?;
        server.verify(trial, name, size).map_err(|error| server.take_back(&tried, error))?;
        server.delete(&tried)?;
    }
    let new = server.import_new(name, &drawing.path, &before)?;
    before.iter().try_for_each(|old| server.delete(old))?;
    let mut outcome = "imported into BeamConstruct".to_owned();
    if !before.is_empty() {
        outcome += ", replacing the older one";
    }
    if let Some(size) = drawing.size {
        server.verify(name, name, size).map_err(|error| server.take_back(&new, error))?;
        outcome += &format!(", size checked: {:.3} x {:.3} mm", size[0], size[1]);
    }
    Ok(outcome)
}
