//! What people ask of a running station from another terminal: one small file for each request in
//! `state/requests/`, removed when it is taken. A station that does not run takes them when it starts.

use std::path::Path;
use std::time::{SystemTime, UNIX_EPOCH};

use fs_err as fs;

use crate::config::Sku;
use crate::files::{make_folder, write_whole_unsynced};

const FOLDER: &str = "requests";
/// Endings of names that are still being written are none of these.
const ENDING: &str = ".txt";

/// What is asked.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Request {
    /// Try now whatever waits for its next try.
    Waiting,
    /// Correct outdated drawings again, of one SKU or of all.
    Outdated(Option<Sku>),
    /// Deliver the drawing of this name again, or all, of those that may not have been delivered.
    Uncertain(Option<String>),
}

impl Request {
    /// Leaves the request for the station whose state folder this is.
    ///
    /// # Errors
    /// When the folder cannot be written to.
    pub fn leave(&self, state: &Path) -> std::io::Result<()> {
        let folder = state.join(FOLDER);
        fs::create_dir_all(state)?;
        make_folder(&folder)?;
        let words = match self {
            Self::Waiting => "waiting".to_owned(),
            Self::Outdated(None) => "outdated".to_owned(),
            Self::Outdated(Some(sku)) => format!("outdated {sku}"),
            Self::Uncertain(None) => "uncertain".to_owned(),
            Self::Uncertain(Some(name)) => format!("uncertain {name}"),
        };
        let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        let name = format!("{:020}-{}{ENDING}", since.as_nanos(), std::process::id());
        write_whole_unsynced(&folder, &name, format!("{words}\n").as_bytes())
    }

    fn parse(text: &str) -> Option<Self> {
        match text.trim().split_once(' ') {
            None if text.trim() == "waiting" => Some(Self::Waiting),
            None if text.trim() == "outdated" => Some(Self::Outdated(None)),
            None if text.trim() == "uncertain" => Some(Self::Uncertain(None)),
            // Names may have any number of spaces in them.
            Some(("uncertain", name)) => Some(Self::Uncertain(Some(name.to_owned()))),
            Some(("outdated", sku)) => sku.trim().parse().ok().map(|sku| Self::Outdated(Some(sku))),
            _ => None,
        }
    }
}

/// All requests, oldest first; they are removed. One that cannot be removed is left for the next time, unheard.
pub(crate) fn take(state: &Path) -> Vec<Request> {
    let Ok(entries) = std::fs::read_dir(state.join(FOLDER)) else { return Vec::new() };
    let mut files: Vec<_> = entries.flatten().map(|entry| entry.path()).collect();
    files.retain(|path| path.file_name().is_some_and(|name| name.to_string_lossy().ends_with(ENDING)));
    files.sort();
    let mut requests = Vec::new();
    for file in files {
        let text = fs::read_to_string(&file).unwrap_or_default();
        if fs::remove_file(&file).is_ok() {
            match Request::parse(&text) {
                Some(request) => requests.push(request),
                None => tracing::warn!("a request is not understood: {:?}", text.trim()),
            }
        }
    }
    requests
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn requests_come_once_and_in_order() {
        let state = tempfile::tempdir().unwrap();
        let all = [
            Request::Waiting,
            Request::Outdated(None),
            Request::Outdated(Some("Can 5".parse().unwrap())),
            Request::Uncertain(None),
            Request::Uncertain(Some("can@a  b.dxf".into())),
        ];
        all.iter().for_each(|request| request.leave(state.path()).unwrap());
        std::fs::write(state.path().join(FOLDER).join("x.txt"), "dance").unwrap();
        assert_eq!(take(state.path()), all);
        assert_eq!(take(state.path()), []);
    }
}
