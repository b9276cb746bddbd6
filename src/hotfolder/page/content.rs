//! The state of the station as HTML: one piece for each section of the page.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;

use super::access::Secrets;
use super::fleet;
use super::pieces::{heading, more, time};
use super::records::{Action, Record};
use crate::hotfolder::state::status::{
    Finished, FinishedAs, Rejection, State, Status, UncertainDrawing, Waits,
};
use crate::reason::Reason;
use crate::report_html::{BASE_STYLE, Markup, compact, hash, safe};

const SCRIPT: &str = include_str!("page.js");
/// Rows of a list; the rest is counted.
const ROWS: usize = 50;

/// The sections of the page, by the identities of their elements.
pub(super) const PIECES: [&str; 7] =
    ["now", "trouble", "finished", "waiting", "uncertain", "rejected", "fleet"];

/// The rejected folder, as it was found last.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct InRejected {
    /// How many drops are in it; `None` before the first look.
    pub(super) count: Option<usize>,
    /// Those of the listed rejections that are still in it.
    pub(super) drops: BTreeSet<String>,
}

/// What the page shows, and what its links and buttons mean.
#[derive(Default)]
pub(super) struct Content {
    pub(super) title: String,
    pub(super) pieces: Vec<String>,
    pub(super) records: BTreeMap<String, Record>,
    pub(super) actions: BTreeMap<String, Action>,
}

impl Content {
    /// The page before the first status.
    pub(super) fn starting() -> Self {
        let mut pieces = vec![String::new(); PIECES.len()];
        pieces[0] = headline("busy", "Starting", "The station checks its folders.").finished();
        for (id, piece) in
            PIECES.iter().zip(&mut pieces).filter(|(id, _)| ["finished", "waiting", "rejected"].contains(id))
        {
            let mut body = Markup::default();
            heading(&mut body, id, "…");
            *piece = body.finished();
        }
        Self { title: "Starting".into(), pieces, ..Self::default() }
    }

    /// The page of a status; `state` is that of the station now.
    pub(super) fn of(status: &Status, state: State, rejected: &InRejected, secrets: &Secrets) -> Self {
        let mut content = Self::default();
        let now = now(status, state, rejected);
        content.title = format!("{}: {}", now.word, status.station);
        let pieces = [
            now.markup,
            troubles(status),
            content.finished(status, secrets),
            content.waiting(status, secrets),
            content.uncertain(status, secrets),
            content.rejected(status, rejected, secrets),
            fleet::fleet(status),
        ];
        content.pieces = pieces.into_iter().map(Markup::finished).collect();
        content
    }

    /// A form with one button.
    fn button(&mut self, body: &mut Markup, secrets: &Secrets, action: Action, label: &str, of: &str) {
        let key = match &action {
            Action::TryWaiting => secrets.name(&["try"]),
            Action::Return(drop) => secrets.name(&["return", drop]),
            Action::DeliverAgain(name) => secrets.name(&["deliver", name]),
        };
        let _ = write!(
            body,
            "<form method=\"post\" action=\"{}\"><input type=\"hidden\" name=\"token\" value=\"{}\"><input type=\"hidden\" \
             name=\"key\" value=\"{key}\"><button id=\"b-{key}\" aria-label=\"{label} {}\">{label}</button></form>",
            action.path(),
            secrets.token(),
            safe(of)
        );
        self.actions.insert(key, action);
    }

    fn finished(&mut self, status: &Status, secrets: &Secrets) -> Markup {
        let mut body = Markup::default();
        heading(&mut body, "finished", "Newest drops");
        if status.finished.is_empty() {
            body.raw("<p class=\"quiet\">No drop is finished yet. Drop a part and a drawing into the hot folder.</p>\n");
            return body;
        }
        body.raw("<ol class=\"drops\">\n");
        let (mut ids, mut shown) = (Ids::default(), BTreeSet::new());
        for finished in &status.finished {
            let id = ids.unique(secrets.name(&["finished", &finished.at, &finished.drop]));
            // The reports folder has the files of the newest drawing with its name only.
            let record = Record::of(finished).filter(|_| shown.insert((&finished.sku, &finished.drawing)));
            finished_row(&mut body, &id, finished, record.is_some());
            if let Some(record) = record {
                self.records.insert(id, record);
            }
        }
        body.raw("</ol>\n");
        body
    }

    fn waiting(&mut self, status: &Status, secrets: &Secrets) -> Markup {
        let mut body = Markup::default();
        heading(&mut body, "waiting", "Waiting");
        let (waiting, incomplete) = (&status.waiting, &status.incomplete);
        if !status.under_way.is_empty() {
            body.raw("<h3>In work</h3>\n<ul class=\"rows\">\n");
            for job in status.under_way.iter().take(ROWS) {
                body.raw("<li><b class=\"name\">").text(&job.drop);
                let _ = writeln!(body, "</b> for {:.0} s</li>", job.for_s);
            }
            body.raw("</ul>\n");
        }
        if waiting.count + incomplete.count == 0 {
            body.raw("<p class=\"quiet\">Nothing waits.</p>\n");
        }
        let mut ids = Ids::default();
        for (title, list) in [("", waiting), ("Not complete yet", incomplete)] {
            if list.count == 0 {
                continue;
            }
            if !title.is_empty() {
                let _ = writeln!(body, "<h3>{title}: {}</h3>", list.count);
            }
            body.raw("<ul class=\"rows\">\n");
            for Waits { drop, reason } in list.first.iter().take(ROWS) {
                let id = ids.unique(secrets.name(&["waits", drop]));
                row(&mut body, &id, drop, &format!("{drop} waits: {}", reason.what), |body| {
                    explained(body, drop, reason)
                });
            }
            body.raw("</ul>\n");
            more(&mut body, list.count, list.first.len().min(ROWS));
            if title.is_empty() {
                self.button(&mut body, secrets, Action::TryWaiting, "Retry all", "that wait");
            }
        }
        if status.outdated.count > 0 {
            let _ = writeln!(
                body,
                "<h3>Outdated: {}</h3>\n<p class=\"quiet\">A new part or new settings would change these delivered drawings. \
                 <code>isomark retry STATION.toml --outdated</code> corrects them again.</p>\n<ul class=\"rows\">",
                status.outdated.count
            );
            for drawing in status.outdated.first.iter().take(ROWS) {
                body.raw("<li><b class=\"name\">").text(&drawing.name).raw("</b></li>\n");
            }
            body.raw("</ul>\n");
            more(&mut body, status.outdated.count, status.outdated.first.len().min(ROWS));
        }
        body
    }

    fn uncertain(&mut self, status: &Status, secrets: &Secrets) -> Markup {
        let mut body = Markup::default();
        let uncertain = &status.uncertain;
        if uncertain.count == 0 {
            return body;
        }
        heading(&mut body, "uncertain", "Perhaps not delivered");
        body.raw(
            "<p>The station was interrupted while it delivered these drawings. Check whether the marking software has them. If not, \
             deliver them again.</p>\n<ul class=\"rows\">\n",
        );
        let mut ids = Ids::default();
        for UncertainDrawing { name, at, .. } in uncertain.first.iter().take(ROWS) {
            let id = ids.unique(secrets.name(&["uncertain", name]));
            row(&mut body, &id, name, &format!("{name} may not have been delivered"), |body| {
                body.raw("<p>Interrupted before ");
                time(body, at);
                body.raw("</p>");
                self.button(body, secrets, Action::DeliverAgain(name.clone()), "Deliver again", name);
            });
        }
        body.raw("</ul>\n");
        more(&mut body, uncertain.count, uncertain.first.len().min(ROWS));
        body
    }

    fn rejected(&mut self, status: &Status, rejected: &InRejected, secrets: &Secrets) -> Markup {
        let mut body = Markup::default();
        heading(&mut body, "rejected", "Rejected");
        let mut left = rejected.drops.clone();
        // Only the newest rejection of a drop can be retried.
        let (there, over): (Vec<&Rejection>, Vec<&Rejection>) =
            status.rejections.iter().partition(|rejection| left.remove(&rejection.drop));
        let is_known = rejected.count.is_some();
        let (now, before) = if is_known { (there, over) } else { (over, Vec::new()) };
        if now.is_empty() && rejected.count.unwrap_or(0) == 0 {
            body.raw("<p class=\"quiet\">No rejected drop is left.</p>\n");
        }
        let mut ids = Ids::default();
        let mut list = |body: &mut Markup, rejections: &[&Rejection], has_button: bool| {
            body.raw("<ul class=\"rows\">\n");
            for rejection in rejections {
                let Rejection { at, drop, reason } = *rejection;
                let id = ids.unique(secrets.name(&["rejected", at, drop]));
                row(body, &id, drop, &format!("{drop} was rejected: {}", reason.what), |body| {
                    body.raw("<p><span class=\"chip bad\">Rejected</span> ");
                    time(body, at);
                    body.raw("</p>");
                    explained(body, drop, reason);
                    if has_button {
                        self.button(body, secrets, Action::Return(drop.clone()), "Retry", drop);
                    }
                });
            }
            body.raw("</ul>\n");
        };
        if !now.is_empty() {
            list(&mut body, &now, is_known);
        }
        if let Some(rest) =
            rejected.count.and_then(|count| count.checked_sub(now.len())).filter(|rest| *rest > 0)
        {
            let drops = if rest == 1 { "older rejected drop is" } else { "older rejected drops are" };
            let _ = writeln!(
                body,
                "<p>{rest} {drops} in the folder <code>rejected</code>, with the reason beside it.</p>"
            );
        }
        if !before.is_empty() {
            let _ = writeln!(
                body,
                "<details id=\"before\"><summary>Retried or removed since: {}</summary>",
                before.len()
            );
            list(&mut body, &before, false);
            body.raw("</details>\n");
        }
        body
    }
}

/// Identities of elements, each used once.
#[derive(Default)]
struct Ids(BTreeMap<String, usize>);

impl Ids {
    fn unique(&mut self, name: String) -> String {
        let count = self.0.entry(name.clone()).or_default();
        *count += 1;
        match *count {
            1 => name,
            more => format!("{name}-{more}"),
        }
    }
}

/// The state that a person sees from three metres away.
struct Now {
    word: &'static str,
    markup: Markup,
}

fn now(status: &Status, state: State, rejected: &InRejected) -> Now {
    let at_work = status.under_way.len();
    let waits = status.waiting.count + status.incomplete.count;
    let (class, word, how) = match state {
        State::Running if !status.troubles.is_empty() => ("warn", "Trouble", "The station runs; see below."),
        State::Running if at_work > 0 => ("busy", "Working", "The station corrects what was dropped."),
        State::Running => ("good", "Ready", "Drop parts and drawings into the hot folder."),
        State::Silent => (
            "bad",
            "No answer",
            "The station has not reported for 30 s: it hangs. Read its log, or start it again.",
        ),
        State::Stopped | State::EndedSilently => ("bad", "Stopped", "Start the station with isomark watch."),
    };
    let mut markup = headline(class, word, how);
    markup.raw("<ul class=\"tiles\">\n");
    let rejections = rejected.count.map_or("–".to_owned(), |count| count.to_string());
    let done = &status.done;
    for (place, class, count, text) in [
        ("waiting", if at_work > 0 { "busy" } else { "" }, at_work.to_string(), "in progress"),
        (
            "waiting",
            if waits > 0 { "warn" } else { "" },
            waits.to_string(),
            if waits == 1 { "waits" } else { "wait" },
        ),
        ("rejected", if rejected.count.unwrap_or(0) > 0 { "bad" } else { "" }, rejections, "rejected"),
        ("finished", "", done.delivered_last_hour.to_string(), "delivered in the last hour"),
    ] {
        let _ = writeln!(
            markup,
            "<li class=\"tile {class}\"><a href=\"#h-{place}\"><b>{count}</b> <span>{text}</span></a></li>"
        );
    }
    let parts = if done.learned == 1 { "part" } else { "parts" };
    markup.raw("</ul>\n<p class=\"quiet\">Since ");
    time(&mut markup, &status.since);
    let _ = writeln!(
        markup,
        ": {} delivered, {} rejected, {} {parts} fitted. {} rejected in the last hour.</p>",
        done.delivered, done.rejected, done.learned, done.rejected_last_hour
    );
    Now { word, markup }
}

fn headline(class: &str, word: &str, how: &str) -> Markup {
    let mut markup = Markup::default();
    let _ = writeln!(
        markup,
        "<div class=\"state {class}\" data-news=\"{word}\"><p class=\"word\">{word}</p><p class=\"how\">{how}</p></div>"
    );
    markup
}

fn troubles(status: &Status) -> Markup {
    let mut body = Markup::default();
    if status.troubles.is_empty() {
        return body;
    }
    heading(&mut body, "trouble", "Trouble");
    body.raw("<ul class=\"rows\">\n");
    for trouble in status.troubles.iter().take(ROWS) {
        body.raw("<li class=\"trouble\">").text(trouble).raw("</li>\n");
    }
    body.raw("</ul>\n");
    body
}

fn row(body: &mut Markup, id: &str, name: &str, news: &str, content: impl FnOnce(&mut Markup)) {
    let _ =
        write!(body, "<li id=\"r-{id}\" data-news=\"{}\"><b class=\"name\">{}</b>", safe(news), safe(name));
    content(body);
    body.raw("</li>\n");
}

fn finished_row(body: &mut Markup, id: &str, finished: &Finished, has_files: bool) {
    let Finished { at, drop, sku, drawing, result } = finished;
    // A drawing from the archive has no place in the hot folder.
    let name = match (result, drawing) {
        (FinishedAs::DeliveredAgain, Some(drawing)) => drawing,
        _ => drop,
    };
    let (class, word) = match result {
        FinishedAs::Delivered => ("good", "Delivered"),
        FinishedAs::DeliveredAgain => ("good", "Delivered again"),
        FinishedAs::Repeated => ("", "Delivered before"),
        FinishedAs::Uncertain => ("warn", "Perhaps not delivered"),
        FinishedAs::Learned => ("good", "Part fitted"),
        FinishedAs::HandedOver => ("", "Handed over"),
    };
    let shown = safe(name);
    let _ = write!(body, "<li id=\"f-{id}\" data-news=\"{shown}: {word}\">");
    if has_files {
        let _ = write!(
            body,
            "<a class=\"thumb\" href=\"/picture/{id}.svg\" target=\"_blank\" rel=\"noopener\"><img \
             src=\"/picture/{id}.svg#after\" alt=\"Picture of {shown}\" width=\"160\" height=\"80\"></a>"
        );
    } else {
        body.raw("<span class=\"thumb none\" aria-hidden=\"true\">part</span>");
    }
    let _ = write!(
        body,
        "<div><b class=\"name\">{shown}</b><p><span class=\"chip {class}\">{word}</span> <span class=\"quiet\">{} · ",
        safe(sku)
    );
    time(body, at);
    body.raw("</span></p>");
    if has_files {
        let _ = write!(
            body,
            "<p><a href=\"/report/{id}.html\" target=\"_blank\" rel=\"noopener\" aria-label=\"3-D report of {shown}\">3-D \
             report</a></p>"
        );
    }
    body.raw("</div></li>\n");
}

/// What is wrong, where, and what to do.
fn explained(body: &mut Markup, drop: &str, reason: &Reason) {
    body.raw("<p>").text(&reason.what).raw("</p>");
    let place = Some(reason.place.to_string()).filter(|place| !place.is_empty() && place != drop);
    let number = reason.number.as_ref().map(ToString::to_string);
    let facts: Vec<String> = place.into_iter().chain(number).collect();
    if !facts.is_empty() {
        body.raw("<p class=\"quiet\">").text(&facts.join("; ")).raw("</p>");
    }
    body.raw("<p><b>What to do:</b> ").text(&reason.remedy).raw("</p>");
}

/// The constant frame of the page, with its content security policy.
pub(super) struct Frame {
    script: String,
    style: String,
    pub(super) policy: String,
}

impl Frame {
    pub(super) fn new() -> Self {
        let script = compact(SCRIPT);
        let style = compact(&format!("{BASE_STYLE}{}", include_str!("page.css")));
        let policy = format!(
            "default-src 'none'; script-src '{}'; style-src '{}'; img-src 'self' data:; connect-src 'self'; form-action 'self'; \
             base-uri 'none'; frame-ancestors 'none'",
            hash(&script),
            hash(&style)
        );
        Self { script, style, policy }
    }

    /// The page; `version` names this start of the station, and `done` states what a button did.
    pub(super) fn page(&self, content: &Content, station: &str, version: &str, done: Option<&str>) -> String {
        let piece = |index: usize| {
            let (id, piece) = (PIECES[index], content.pieces.get(index).map_or("", String::as_str));
            match id {
                "now" | "trouble" | "uncertain" | "fleet" => format!("<div id=\"p-{id}\">{piece}</div>\n"),
                _ => format!("<section id=\"p-{id}\" aria-labelledby=\"h-{id}\">{piece}</section>\n"),
            }
        };
        let [first, second, third, last] =
            [0..2, 2..3, 3..6, 6..PIECES.len()].map(|range| range.map(piece).collect::<String>());
        let body = format!(
            "<header><h1>{}</h1><p id=\"link\" class=\"quiet\" hidden></p></header>\n\
             <p id=\"lost\" class=\"lost\" role=\"alert\"></p>\n<main>\n<p id=\"done\" class=\"done\" role=\"status\">{}</p>\n\
             <p id=\"live\" class=\"apart\" role=\"status\"></p>\n{first}<div class=\"columns\">\n{second}<div>\n{third}</div>\n\
             </div>\n{last}</main>\n",
            safe(station),
            done.map(safe).unwrap_or_default(),
        );
        self.document(
            &content.title,
            version,
            &body,
            "<noscript><meta http-equiv=\"refresh\" content=\"10;url=/\"></noscript>\n",
        )
    }

    /// A page with one message.
    pub(super) fn message(&self, title: &str, text: &str, remedy: &str) -> String {
        let mut body = Markup::default();
        body.raw("<main>\n<h1>").text(title).raw("</h1>\n<p>").text(text).raw("</p>\n<p>").text(remedy);
        body.raw("</p>\n<p><a href=\"/\">Open the page of the station</a></p>\n</main>\n");
        self.document(title, "", &body.finished(), "")
    }

    fn document(&self, title: &str, version: &str, body: &str, head: &str) -> String {
        let script =
            if version.is_empty() { String::new() } else { format!("<script>{}</script>\n", self.script) };
        format!(
            "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
             <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
             <meta name=\"color-scheme\" content=\"light dark\">\n<link rel=\"icon\" href=\"data:,\">\n{head}\
             <title>{}</title>\n<style>{}</style>\n</head>\n<body data-version=\"{version}\">\n{body}{script}</body>\n</html>\n",
            safe(title),
            self.style
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn script_and_style_contain_nothing_that_ends_them() {
        let Frame { script, style, .. } = Frame::new();
        for text in [script, style] {
            let text = text.to_lowercase();
            assert!(["</script", "</style", "<!--"].iter().all(|end| !text.contains(end)));
        }
    }

    #[test]
    fn long_lists_are_cut_and_state_what_is_left_out() {
        let reason = serde_json::json!({"code": "x", "what": "w".repeat(5000), "remedy": "r".repeat(5000)});
        let waits: Vec<_> =
            (0..500).map(|index| serde_json::json!({"drop": format!("{index}"), "reason": reason})).collect();
        let rejections: Vec<_> = (0..20)
            .map(|index| serde_json::json!({"at": "", "drop": format!("{}", index % 3), "reason": reason}))
            .collect();
        let status: Status = serde_json::from_value(serde_json::json!({
            "schema": "", "station": "", "running": true, "at": "", "since": "", "under_way": [], "rejections": rejections,
            "done": {"delivered": 0, "learned": 0, "rejected": 0, "delivered_last_hour": 0, "rejected_last_hour": 0},
            "waiting": {"count": 700, "first": waits}, "incomplete": {"count": 0, "first": []},
            "outdated": {"count": 0, "first": []},
        }))
        .unwrap();
        let secrets = Secrets::new(None).unwrap();
        let rejected = InRejected { count: Some(9), drops: ["1".to_owned()].into() };
        let content = Content::of(&status, State::Running, &rejected, &secrets);
        let [_, _, _, waiting, _, rejected, _] = &content.pieces[..] else { panic!("seven pieces") };
        assert!(waiting.contains("and 650 more") && waiting.len() < 200_000, "{}", waiting.len());
        assert!(
            rejected.contains("8 older rejected drops are") && rejected.contains("since: 19"),
            "{rejected}"
        );
        // One button for all that wait, one for the drop that is still rejected.
        let actions: Vec<_> = content.actions.values().collect();
        assert_eq!(actions.len(), 2, "{actions:?}");
        // Every element has its own identity.
        let page = Frame::new().page(&content, "x", "1", None);
        let ids: Vec<&str> = page.split(" id=\"").skip(1).filter_map(|rest| rest.split('"').next()).collect();
        assert_eq!(ids.iter().collect::<BTreeSet<_>>().len(), ids.len());
        for link in page.split("href=\"#").skip(1).filter_map(|rest| rest.split('"').next()) {
            assert!(ids.contains(&link), "{link}");
        }
    }
}
