//! A client of BeamServer: imports a drawing into BeamConstruct, sees to it that it has its true size, and removes the
//! older drawing of the same name. It knows no command that starts marking: that is a person's decision.
//!
//! BeamServer (OpenAPC manual, 7.10) takes one ASCII command a line on TCP and answers with a line: `OK`, the value
//! that was asked for, or `ERROR a b` with two numbers. It talks to one client at a time, so each delivery connects
//! and lets go again.
//!
//! | step | commands |
//! |---|---|
//! | what is there | `CmdListName n`, `CmdListUID n` for n = 0, 1 … until an error |
//! | import | `CmdImport <path>` |
//! | find it | the list again: an element of this name that was not there before |
//! | its size | `CmdSelEntName \<name>`, `CmdGetSizeX`, `CmdGetSizeY`, in 1/10000 mm |
//! | remove it, or an older one | `CmdDeleteEnt <id>` |
//!
//! Elements are selected by name alone, so that the size of a drawing cannot be asked for as long as an older one of its
//! name is there. A drawing that replaces one is therefore imported twice: for trial under a name of its own, and only
//! if its size is right in place of the older one. A drawing of a wrong size is removed, so that it cannot be marked.

mod client;
mod gate;

use std::path::Path;

use super::api::JobError;
use super::seen::StopSignal;
use crate::config::DeliverySettings;
use crate::reason::Reason;

use client::{Server, TalkError};
pub(super) use gate::Gate;

/// A drawing in the import folder that BeamConstruct is to hold.
pub(crate) struct Drawing<'a> {
    /// Its file's name, and that of its element.
    pub(crate) name: &'a str,
    /// Its path as BeamServer knows it.
    pub(crate) path: String,
    /// Width and height, mm, if they are known.
    pub(crate) size: Option<[f64; 2]>,
    /// Name and path of the same for trial.
    pub(crate) trial: (&'a str, String),
    /// It was imported before: it is done if it is still there.
    pub(crate) is_known: bool,
}

/// A path that can be sent to BeamServer.
///
/// # Errors
/// Rejects what is not ASCII.
pub(crate) fn sendable(path: &Path) -> Result<String, JobError> {
    let ascii = path.to_str().filter(|path| path.is_ascii() && !path.contains(['\r', '\n']));
    ascii.map(str::to_owned).ok_or_else(|| {
        let what = format!("BeamServer takes ASCII paths only, and {} is none.", path.display());
        let remedy = "Name SKU, drawing and folder in plain letters.";
        JobError::Rejected(Reason::new("beamserver-path", what, remedy))
    })
}

/// Imports the drawing under its name; returns what was done, as words for the log. `lay_out` puts the file for trial
/// where its path says.
pub(crate) fn import(
    delivery: &DeliverySettings,
    drawing: &Drawing<'_>,
    stop: &StopSignal,
    lay_out: impl FnOnce() -> Result<(), JobError>,
) -> Result<String, TalkError> {
    let mut server = Server::connect(delivery, stop)?;
    let name = drawing.name;
    let (trial, trial_path) = &drawing.trial;
    let before = server.elements(name)?;
    if drawing.is_known && before.len() == 1 {
        return Ok("is in BeamConstruct".into());
    }
    // An interruption may have left one.
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
        outcome += ", in place of the older one";
    }
    if let Some(size) = drawing.size {
        server.verify(name, name, size).map_err(|error| server.take_back(&new, error))?;
        outcome += &format!(", {:.3} x {:.3} mm as it should be", size[0], size[1]);
    }
    Ok(outcome)
}
