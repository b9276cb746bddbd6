//! Requests to a running station from another terminal: one small file for each request in `state/requests/`, removed
//! when the station reads it. A stopped station reads them when it starts.

use std::path::Path;
use std::time::{SystemTime, UNIX_EPOCH};

use fs_err as fs;

use crate::config::Sku;
use crate::files::{make_folder, write_whole_unsynced};

const FOLDER: &str = "requests";
/// Files that are still being written have other suffixes.
const ENDING: &str = ".txt";

/// A request.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Request {
    /// Try all waiting drops again now.
    Waiting,
    /// Correct outdated drawings again, of one SKU or of all.
    Outdated(Option<Sku>),
    /// Deliver drawings again that may not have been delivered: the one with this name, or all.
    Uncertain(Option<String>),
}

impl Request {
    /// Writes the request into the state folder of a station.
    ///
    /// # Errors
    /// When the folder cannot be written to.
    pub fn leave(&self, state: &Path) -> std::io::Result<()> {
        let folder = state.join(FOLDER);
        fs::create_dir_all(state)?;
        make_folder(&folder)?;
        let text = match self {
            Self::Waiting => "waiting".to_owned(),
            Self::Outdated(None) => "outdated".to_owned(),
            Self::Outdated(Some(sku)) => format!("outdated {sku}"),
            Self::Uncertain(None) => "uncertain".to_owned(),
            Self::Uncertain(Some(name)) => format!("uncertain {name}"),
        };
        let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        let name = format!("{:020}-{}{ENDING}", since.as_nanos(), std::process::id());
        write_whole_unsynced(&folder, &name, format!("{text}\n").as_bytes())
    }

    fn parse(text: &str) -> Option<Self> {
        match text.trim().split_once(' ') {
            None if text.trim() == "waiting" => Some(Self::Waiting),
            None if text.trim() == "outdated" => Some(Self::Outdated(None)),
            None if text.trim() == "uncertain" => Some(Self::Uncertain(None)),
            // A name may contain any number of spaces.
            Some(("uncertain", name)) => Some(Self::Uncertain(Some(name.to_owned()))),
            Some(("outdated", sku)) => sku.trim().parse().ok().map(|sku| Self::Outdated(Some(sku))),
            _ => None,
        }
    }
}

/// Reads and removes all requests, oldest first. A request that cannot be removed is ignored until the next call.
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
                None => tracing::warn!("ignoring an unknown request: {:?}", text.trim()),
            }
        }
    }
    requests
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn requests_are_read_once_and_in_order() {
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
