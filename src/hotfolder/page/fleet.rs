//! The fleet of the station as HTML.

use std::fmt::Write;

use super::pieces::{heading, more, time};
use crate::hotfolder::fleet::{FleetSeen, StationRow, StationState, WorkerRow};
use crate::hotfolder::state::status::Status;
use crate::report_html::{Markup, safe};

/// Every station with its figures; nothing for a station without a fleet.
pub(super) fn fleet(status: &Status) -> Markup {
    let mut body = Markup::default();
    let Some(FleetSeen { available, at, count, stations, workers, .. }) = &status.fleet else { return body };
    heading(&mut body, "fleet", "Fleet");
    let (class, word) = if *available { ("good", "Available") } else { ("warn", "Not available") };
    let _ = write!(
        body,
        "<p><span class=\"chip {class}\" data-news=\"Fleet: {word}\" id=\"fleet-state\">{word}</span> "
    );
    match at {
        Some(at) => {
            let plural = if *count == 1 { "station" } else { "stations" };
            let _ = write!(body, "<span class=\"quiet\">{count} {plural}, as of ");
            time(&mut body, at);
            body.raw("</span>");
        }
        None => {
            body.raw("<span class=\"quiet\">The other stations are not known yet.</span>");
        }
    }
    body.raw("</p>\n");
    if stations.is_empty() {
        return body;
    }
    body.raw(
        "<div class=\"wide\" tabindex=\"0\" role=\"group\" aria-labelledby=\"h-fleet\"><table><thead><tr><th scope=\"col\">Station</th>\
         <th scope=\"col\">State</th><th scope=\"col\">Waiting</th><th scope=\"col\">Delivered</th><th scope=\"col\">Fitted</th>\
         <th scope=\"col\">Rejected</th><th scope=\"col\">Program</th></tr></thead><tbody>\n",
    );
    stations.iter().for_each(|station| row(&mut body, station));
    body.raw("</tbody></table></div>\n");
    more(&mut body, usize::try_from(*count).unwrap_or(usize::MAX), stations.len());
    if !workers.is_empty() {
        body.raw(
            "<div class=\"wide\" tabindex=\"0\" role=\"group\" aria-label=\"Workers\"><table><thead><tr><th scope=\"col\">Worker</th>\
             <th scope=\"col\">State</th><th scope=\"col\">Fits made</th><th scope=\"col\">Failed</th><th scope=\"col\">Program</th>\
             </tr></thead><tbody>\n",
        );
        workers.iter().for_each(|worker| worker_row(&mut body, worker));
        body.raw("</tbody></table></div>\n");
    }
    body
}

fn worker_row(body: &mut Markup, worker: &WorkerRow) {
    let WorkerRow { name, alive, silent_for_s, program, made, failed, sku, .. } = worker;
    let (class, word) = match (alive, sku) {
        (false, _) => ("bad", format!("Silent for {}", span(*silent_for_s))),
        (true, Some(sku)) => ("good", format!("Fits {}", safe(sku))),
        (true, None) => ("good", "Alive".to_owned()),
    };
    let _ = writeln!(
        body,
        "<tr><th scope=\"row\">{}</th><td><span class=\"chip {class}\">{word}</span></td><td>{made}</td><td>{failed}</td>\
         <td>{}</td></tr>",
        safe(name),
        safe(program)
    );
}

fn row(body: &mut Markup, station: &StationRow) {
    let StationRow { name, state, silent_for_s, program, waiting, delivered, learned, rejected, .. } =
        station;
    let (class, word) = match state {
        StationState::Alive => ("good", "Alive".to_owned()),
        StationState::Silent => ("bad", format!("Silent for {}", span(*silent_for_s))),
        StationState::Stopped => ("", "Stopped".to_owned()),
    };
    let _ = write!(
        body,
        "<tr><th scope=\"row\">{}</th><td><span class=\"chip {class}\">{word}</span></td><td>{waiting}</td><td>{delivered}</td>\
         <td>{learned}</td><td>{rejected}</td><td>{}",
        safe(name),
        safe(program)
    );
    if let Some(trouble) = &station.trouble {
        body.raw("<p class=\"trouble\">").text(trouble).raw("</p>");
    }
    body.raw("</td></tr>\n");
}

/// A time as people say it, in whole units.
fn span(seconds: f64) -> String {
    match seconds {
        s if s < 120.0 => format!("{s:.0} s"),
        s if s < 7200.0 => format!("{:.0} min", s / 60.0),
        s if s < 172_800.0 => format!("{:.0} h", s / 3600.0),
        s => format!("{:.0} days", s / 86_400.0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_station_is_shown_and_its_names_are_text() {
        let hostile = "<script>\"'&\u{202e}\n";
        let station = |name: &str, state: &str| {
            serde_json::json!({
                "name": name, "state": state, "silent_for_s": 7300.0, "up_for_s": 1.0, "program": hostile, "waiting": 12, "delivered": 34,
                "learned": 5, "rejected": 67, "outdated": 0, "uncertain": 0, "trouble": hostile
            })
        };
        let stations = [station("laser 1", "alive"), station(hostile, "silent"), station("old", "stopped")];
        let worker = |name: &str, alive: bool, sku: Option<&str>| {
            serde_json::json!({
                "name": name, "alive": alive, "silent_for_s": 60.0, "up_for_s": 90.0, "program": hostile, "made": 81, "failed": 2, "sku": sku
            })
        };
        let workers = [
            worker("cellar", true, None),
            worker("attic", true, Some(hostile)),
            worker(hostile, false, None),
        ];
        let mut status: Status = serde_json::from_value(serde_json::json!({
            "schema": "", "station": "", "running": true, "at": "", "since": "", "under_way": [], "rejections": [],
            "done": {"delivered": 0, "learned": 0, "rejected": 0, "delivered_last_hour": 0, "rejected_last_hour": 0},
            "waiting": {"count": 0, "first": []}, "incomplete": {"count": 0, "first": []},
            "outdated": {"count": 0, "first": []},
            "fleet": {"name": "laser 1", "available": true, "at": hostile, "count": 5, "stations": stations, "workers": workers},
        }))
        .unwrap();
        let shown = fleet(&status).finished();
        for words in [
            "laser 1",
            ">Alive<",
            "Silent for 2 h",
            ">Stopped<",
            "<td>12</td><td>34</td><td>5</td><td>67</td>",
            "and 2 more",
            ">cellar</th><td><span class=\"chip good\">Alive</span></td><td>81</td><td>2</td>",
            ">Silent for 60 s<",
        ] {
            assert!(shown.contains(words), "{words}: {shown}");
        }
        assert!(!shown.contains("<script") && !shown.contains('\u{202e}'), "{shown}");
        status.fleet = None;
        assert_eq!(fleet(&status).finished(), "");
    }
}
