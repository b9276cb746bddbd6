//! The jobs for other lines in `isomark fleet status`.

use crate::fleet::{JobRow, Jobs};
use crate::printable::on_one_line;

/// The jobs of a fleet, for people.
pub(super) fn words_of_jobs(jobs: &Jobs) -> String {
    if jobs.listed.is_empty() {
        return String::new();
    }
    let mut text = format!("jobs for other lines: {} waiting, {} taken\n", jobs.waiting, jobs.taken);
    for job in &jobs.listed {
        let JobRow { id, line, name, sender, state, age_s, station, outcome, reason, .. } = job;
        let [line, name, sender] = [line, name, sender].map(|text| on_one_line(text));
        let state = match (outcome, station) {
            (Some(outcome), Some(station)) => format!("{outcome} at {}", on_one_line(station)),
            (None, Some(station)) => format!("{state} by {}", on_one_line(station)),
            _ => state.clone(),
        };
        let id = id.get(..12).unwrap_or(id);
        text += &format!("  {id} {name}: {sender} to {line}, {age_s:.0} s ago: {state}");
        if let Some(reason) = reason {
            text += &format!(" ({})", on_one_line(reason));
        }
        text += "\n";
    }
    text
}
