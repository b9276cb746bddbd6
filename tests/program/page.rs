//! The page of a running station, asked over plain sockets, so that any request can be made, and in a real browser.

use std::collections::BTreeSet;
use std::io::{ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::process::Command;
use std::time::{Duration, Instant};

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;

use serde_json::Value;

use crate::browser;
use crate::desk::drawing;
use crate::station::Station;

/// A shallow trough as OBJ.
const PART: &str =
    "v -20 -20 1\nv 0 -20 0\nv 20 -20 1\nv -20 20 1\nv 0 20 0\nv 20 20 1\nf 1 2 5 4\nf 2 3 6 5\n";
/// The time limit for one answer on a slow machine.
const LIMIT: Duration = Duration::from_secs(60);
/// Connections at the same time, as `src/hotfolder/page/mod.rs` promises a bound.
const BOUND: usize = 64;

/// A running station with its page.
struct Shown {
    station: Station,
    at: SocketAddr,
}

/// An answer.
#[derive(Debug)]
struct Reply {
    code: u16,
    /// In lower case, each on its line.
    headers: String,
    body: Vec<u8>,
}

impl Reply {
    fn text(&self) -> String {
        String::from_utf8(self.body.clone()).unwrap()
    }

    fn header(&self, name: &str) -> Option<&str> {
        self.headers.lines().find_map(|line| line.strip_prefix(name)?.strip_prefix(": "))
    }
}

impl Shown {
    /// Starts the station; the options name the page with the port 0, so that tests can run side by side.
    fn of(mut station: Station, options: &[&str]) -> Self {
        station.start_with(options);
        station
            .waits_for("the page", |station| station.log().contains("the page of the station is at http://"));
        let log = station.log();
        let port = log.split("the page of the station is at http://").last().unwrap();
        let port = port.split(['/', ' ']).next().unwrap().rsplit(':').next().unwrap();
        Self { station, at: SocketAddr::from(([127, 0, 0, 1], port.parse().unwrap())) }
    }

    fn new() -> Self {
        Self::of(Station::new(), &["--page", "127.0.0.1:0"])
    }

    fn connect(&self) -> TcpStream {
        let stream = TcpStream::connect(self.at).unwrap();
        stream.set_read_timeout(Some(LIMIT)).unwrap();
        stream.set_write_timeout(Some(LIMIT)).unwrap();
        stream
    }

    /// Sends bytes and reads until the page closes the connection. `None` if it closes it without an answer.
    fn send(&self, bytes: &[u8]) -> Option<Reply> {
        let mut stream = self.connect();
        // The page may answer and close before it has read everything.
        let _ = stream.write_all(bytes);
        let mut answer = Vec::new();
        if let Err(error) = stream.read_to_end(&mut answer) {
            let is_closed =
                [ErrorKind::ConnectionReset, ErrorKind::ConnectionAborted].contains(&error.kind());
            assert!(is_closed, "{error}: no answer to {:?}", String::from_utf8_lossy(bytes));
        }
        let end = answer.windows(4).position(|window| window == b"\r\n\r\n")?;
        let head = String::from_utf8(answer[..end].to_vec()).unwrap();
        let code = head.split(' ').nth(1).unwrap().parse().unwrap();
        Some(Reply {
            code,
            headers: head.to_lowercase().replace("\r\n", "\n"),
            body: answer[end + 4..].to_vec(),
        })
    }

    fn ask(&self, method: &str, path: &str, headers: &[(&str, &str)], body: &str) -> Reply {
        let mut text = format!("{method} {path} HTTP/1.1\r\n");
        if !headers.iter().any(|(name, _)| *name == "Host") {
            text += &format!("Host: {}\r\n", self.at);
        }
        for (name, value) in headers.iter().filter(|(_, value)| *value != "-") {
            text += &format!("{name}: {value}\r\n");
        }
        if method == "POST" {
            text += &format!(
                "Content-Type: application/x-www-form-urlencoded\r\nContent-Length: {}\r\n",
                body.len()
            );
        }
        self.send(format!("{text}\r\n{body}").as_bytes()).unwrap()
    }

    fn get(&self, path: &str) -> Reply {
        self.ask("GET", path, &[], "")
    }

    fn page(&self) -> String {
        let reply = self.get("/");
        assert_eq!(reply.code, 200, "{reply:?}");
        reply.text()
    }

    /// The page, as soon as it has all of these words.
    fn page_with(&self, words: &[&str]) -> String {
        let started = Instant::now();
        loop {
            let page = self.page();
            if words.iter().all(|word| page.contains(word)) {
                return page;
            }
            assert!(started.elapsed() < LIMIT, "{words:?} not in {page}\n{}", self.station.log());
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    fn post(&self, path: &str, token: &str, key: &str) -> Reply {
        self.ask(
            "POST",
            path,
            &[("Origin", &format!("http://{}", self.at))],
            &format!("token={token}&key={key}"),
        )
    }

    /// A stream of events after its first event.
    fn events(&self) -> Events {
        let mut stream = self.connect();
        write!(stream, "GET /events HTTP/1.1\r\nHost: {}\r\n\r\n", self.at).unwrap();
        let mut events = Events { stream, read: String::new() };
        events.until("event: state");
        events
    }
}

struct Events {
    stream: TcpStream,
    read: String,
}

impl Events {
    /// Reads until the text has come.
    fn until(&mut self, text: &str) {
        let started = Instant::now();
        let mut bytes = [0; 4096];
        while !self.read.contains(text) {
            assert!(started.elapsed() < LIMIT, "no {text} in {}", self.read);
            let count = self.stream.read(&mut bytes).unwrap();
            assert!(count > 0, "the stream ended before {text}: {}", self.read);
            self.read += &String::from_utf8_lossy(&bytes[..count]);
        }
    }
}

/// The value of a hidden field in the form whose button has this label for screen readers.
fn field(page: &str, name: &str, label: &str) -> String {
    let button =
        page.find(&format!("aria-label=\"{label}\"")).unwrap_or_else(|| panic!("no {label} in {page}"));
    let form = &page[page[..button].rfind("<form").unwrap()..button];
    let value = form.split(&format!("name=\"{name}\" value=\"")).nth(1).unwrap();
    value[..value.find('"').unwrap()].to_owned()
}

/// All values of an attribute.
fn attributes<'p>(page: &'p str, name: &str) -> Vec<&'p str> {
    let pieces = page.split(&format!(" {name}=\"")).skip(1).collect::<Vec<_>>();
    pieces.into_iter().map(|piece| &piece[..piece.find('"').unwrap()]).collect()
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
        .replace('"', "&quot;")
        .replace('\'', "&#39;")
}

/// A station with one drawing delivered, one waiting, and one rejected.
fn with_three_drops() -> Shown {
    let shown = Shown::new();
    shown.station.desk.write("hot/trough.obj", PART);
    shown.station.copy_into(&drawing("square"), "trough@date.dxf");
    shown.station.copy_into(&drawing("square"), "cup@logo.dxf");
    shown.station.desk.write("hot/trough@broken.dxf", "%PDF-1.4\n");
    shown
}

#[test]
fn the_page_lists_what_was_delivered_what_waits_and_what_was_rejected() {
    let shown = with_three_drops();
    let page = shown.page_with(&[
        "trough@date.dxf: Delivered",
        "trough.obj: Part fitted",
        "cup@logo.dxf waits: ",
        "aria-label=\"Retry trough@broken.dxf\"",
    ]);
    let station = &shown.station;
    let reason: Value =
        serde_json::from_slice(&station.desk.read("rejected/trough@broken.dxf.reason.json")).unwrap();
    for text in [
        reason["what"].as_str().unwrap(),
        reason["remedy"].as_str().unwrap(),
        "the SKU `cup` has no surface yet",
    ] {
        assert!(page.contains(&escaped(text)), "{text} is not in {page}");
    }
    for tile in [
        "<b>1</b> <span>waits</span>",
        "<b>1</b> <span>rejected</span>",
        "<b>1</b> <span>delivered in the last hour</span>",
    ] {
        assert!(page.contains(tile), "{tile} is not in {page}");
    }
    assert!(page.contains("<p class=\"word\">Ready</p>") && page.contains("<title>Ready: test</title>"));
    // Its files are those of the reports folder.
    let links: BTreeSet<&str> = attributes(&page, "href")
        .into_iter()
        .filter(|link| link.ends_with(".svg") || link.ends_with(".html"))
        .collect();
    assert_eq!(links.len(), 2, "{links:?}");
    for (link, file, mime, policy) in [
        ("/picture/", "preview.svg", "image/svg+xml", "sandbox"),
        ("/report/", "report.html", "text/html; charset=utf-8", "sandbox allow-scripts"),
    ] {
        let link = links.iter().find(|all| all.starts_with(link)).unwrap();
        let reply = shown.get(link);
        assert_eq!((reply.code, reply.header("content-type")), (200, Some(mime)));
        assert!(reply.header("content-security-policy").unwrap().ends_with(policy), "{reply:?}");
        assert_eq!(reply.body, station.desk.read(&format!("reports/trough/trough@date.dxf.{file}")));
    }
    // `status --json` has the same.
    let status = station.desk.isomark(&["status", "station.toml", "--json"]);
    let status: Value = serde_json::from_str(&status.out).unwrap();
    assert_eq!(status["finished"][0]["drawing"], "trough@date.dxf");
    assert_eq!(status["finished"][0]["result"], "delivered");
    assert_eq!(
        (&status["finished"][1]["drop"], &status["finished"][1]["result"]),
        (&"trough.obj".into(), &"learned".into())
    );
    assert_eq!(status["rejections"][0]["drop"], "trough@broken.dxf");
}

#[test]
fn every_answer_is_protected() {
    let shown = Shown::new();
    for (path, code) in [("/", 200), ("/nothing", 404), ("/retry", 405)] {
        let reply = shown.get(path);
        assert_eq!(reply.code, code);
        let policy = reply.header("content-security-policy").unwrap();
        assert!(
            policy.starts_with("default-src 'none';") && policy.contains("frame-ancestors 'none'"),
            "{policy}"
        );
        assert!(!policy.contains("unsafe"), "{policy}");
        for (name, value) in [
            ("x-content-type-options", "nosniff"),
            ("referrer-policy", "same-origin"),
            ("cache-control", "no-store"),
            ("cross-origin-resource-policy", "same-origin"),
        ] {
            assert_eq!(reply.header(name), Some(value), "{path}");
        }
        assert!(!reply.headers.contains("access-control-"), "{reply:?}");
    }
}

#[test]
fn an_event_arrives_after_a_drop() {
    let shown = Shown::new();
    let mut events = shown.events();
    assert!(events.read.contains("content-type: text/event-stream"), "{}", events.read);
    assert!(!events.read.contains("trough"));
    shown.station.desk.write("hot/trough.obj", PART);
    events.until("trough.obj: Part fitted");
    shown.station.copy_into(&drawing("square"), "trough@date.dxf");
    events.until("trough@date.dxf: Delivered");
    for event in events.read.split("data: ").skip(1).filter_map(|event| event.split_once("\n\n")) {
        let json: Value = serde_json::from_str(event.0.trim_end_matches("\r\n")).unwrap_or_default();
        assert!(json.is_null() || json["pieces"].is_object(), "{event:?}");
    }
}

#[test]
fn a_rejected_drop_is_retried_only_by_a_button_of_the_page() {
    let station = Station::new();
    station.desk.write("skus/trough.toml", "[placement]\nplace_mm = [0, 500]\n");
    station.desk.write("hot/trough.obj", PART);
    station.copy_into(&drawing("square"), "trough.dxf");
    let shown = Shown::of(station, &["--page", "127.0.0.1:0"]);
    let page = shown.page_with(&["aria-label=\"Retry trough.dxf\""]);
    let (token, key) = (field(&page, "token", "Retry trough.dxf"), field(&page, "key", "Retry trough.dxf"));
    let own = format!("http://{}", shown.at);
    let port = shown.at.port();
    let form = format!("token={token}&key={key}");
    let (evil, evil_port) = (format!("127.0.0.1.evil.com:{port}"), format!("http://evil.com:{port}"));
    let (six, other_port) = (format!("[::1]:{port}"), format!("127.0.0.1:{}", port ^ 1));
    let named = format!("localhost.evil:{port}");
    let wrong_token = format!("token={}&key={key}", "0".repeat(32));
    let twice = format!("token=x&{form}");
    let long = format!("{form}&x={}", "x".repeat(2000));
    for (code, method, path, headers, body) in [
        (405, "GET", "/retry", vec![], ""),
        (405, "PUT", "/retry", vec![], &*form),
        (405, "POST", "/", vec![], &*form),
        (404, "GET", "/retry/", vec![], ""),
        (403, "POST", "/retry", vec![], ""),
        (403, "POST", "/retry", vec![], &*format!("key={key}")),
        (403, "POST", "/retry", vec![], &*wrong_token),
        (403, "POST", "/retry", vec![], &*twice),
        (403, "POST", "/retry", vec![("Origin", "null")], &*form),
        (403, "POST", "/retry", vec![("Origin", "http://evil.com")], &*form),
        (403, "POST", "/retry", vec![("Origin", &evil_port)], &*form),
        (403, "POST", "/retry", vec![("Origin", &own), ("Sec-Fetch-Site", "cross-site")], &*form),
        (403, "POST", "/retry", vec![("Sec-Fetch-Site", "same-site")], &*form),
        (421, "POST", "/retry", vec![("Host", &evil), ("Origin", &own)], &*form),
        (421, "POST", "/retry", vec![("Host", &named), ("Origin", &own)], &*form),
        (421, "POST", "/retry", vec![("Host", &six), ("Origin", &own)], &*form),
        (421, "POST", "/retry", vec![("Host", &other_port), ("Origin", &own)], &*form),
        (421, "POST", "/retry", vec![("Host", "127.0.0.1"), ("Origin", &own)], &*form),
        (400, "POST", "/retry", vec![("Host", "-")], &*form),
        (400, "POST", "/retry", vec![("Host", &other_port), ("Host", &other_port)], &*form),
        (400, "POST", &*format!("http://{}/retry", shown.at), vec![], &*form),
        (409, "POST", "/deliver-again", vec![("Origin", &own)], &*form),
        (409, "POST", "/retry", vec![("Origin", &own)], &*format!("token={token}&key={}", "0".repeat(32))),
        (409, "POST", "/retry", vec![("Origin", &own)], &*format!("token={token}&key=trough.dxf")),
        (413, "POST", "/retry", vec![("Origin", &own)], &*long),
    ] {
        let reply = shown.ask(method, path, &headers, body);
        assert_eq!(reply.code, code, "{method} {path} {headers:?} {body}: {reply:?}");
        if code == 405 {
            assert!(reply.header("allow").is_some(), "{reply:?}");
        }
    }
    let other_kind = format!(
        "POST /retry HTTP/1.1\r\nHost: {}\r\nContent-Type: text/plain\r\nContent-Length: {}\r\n\r\n{form}",
        shown.at,
        form.len()
    );
    assert_eq!(shown.send(other_kind.as_bytes()).unwrap().code, 415);
    assert!(
        shown.station.path("rejected/trough.dxf").exists() && !shown.station.log().contains("from the page")
    );
    // Its button works, and the page shows what it did, with and without scripts.
    shown.station.desk.write("skus/trough.toml", "");
    let reply = shown.post("/retry", &token, &key);
    assert_eq!((reply.code, reply.header("location")), (303, Some("/?done=returned")));
    assert!(shown.get("/?done=returned").text().contains("The drop is back in the hot folder."));
    assert!(!shown.get("/?done=%3Cb%3E").text().contains("<b>%"));
    shown.station.waits_for_file("import/trough.dxf");
    let page = shown.page_with(&["trough.dxf: Delivered"]);
    assert!(!page.contains("aria-label=\"Retry trough.dxf\""), "{page}");
    // Another browser still has the button.
    let accept = [("Origin", &*own), ("Accept", "application/json")];
    let reply = shown.ask("POST", "/retry", &accept, &form);
    assert_eq!((reply.code, reply.header("content-type")), (409, Some("application/json")));
    assert!(reply.text().contains("Nothing was done"), "{reply:?}");
}

#[test]
fn waiting_drops_are_tried_again_and_uncertain_ones_delivered_again() {
    let station = Station::new();
    station.desk.write("hot/trough.obj", PART);
    station.copy_into(&drawing("square"), "trough.dxf");
    assert!(station.once().out.starts_with("1 delivered"));
    if !station.interrupt_delivery("trough") {
        return;
    }
    station.copy_into(&drawing("square"), "cup.dxf");
    let shown = Shown::of(station, &["--page", "127.0.0.1:0"]);
    let page =
        shown.page_with(&["aria-label=\"Deliver again trough.dxf\"", "aria-label=\"Retry all that wait\""]);
    assert!(page.contains("trough.dxf may not have been delivered"), "{page}");
    let token = field(&page, "token", "Retry all that wait");
    let reply = shown.post("/retry", &token, &field(&page, "key", "Retry all that wait"));
    assert_eq!((reply.code, reply.header("location")), (303, Some("/?done=waiting")));
    shown.station.waits_for("a retry", |station| station.log().contains("trying all waiting drops again"));
    assert!(shown.station.import().is_empty());
    let reply = shown.post("/deliver-again", &token, &field(&page, "key", "Deliver again trough.dxf"));
    assert_eq!((reply.code, reply.header("location")), (303, Some("/?done=uncertain")));
    shown.station.waits_for_file("import/trough.dxf");
    let page = shown.page_with(&["trough.dxf: Delivered again"]);
    assert!(!page.contains("Deliver again trough.dxf"), "{page}");
}

#[test]
fn hostile_names_are_text_and_lead_to_no_file() {
    let station = Station::new();
    station.desk.write("secret.preview.svg", "a secret");
    station.desk.write("reports/can/real.dxf.preview.svg", "<svg/>");
    // As somebody could have written it who can write into the state folder.
    let hostile = "<script>alert(1)</script>\"'&\u{202e}\n";
    let finished = |drop: &str, sku: &str, drawing: &str| serde_json::json!({"at": "2026-01-01T00:00:00Z", "drop": drop, "sku": sku, "drawing": drawing, "result": "delivered"});
    let status = serde_json::json!({
        "schema": "isomark.status/1", "station": "x", "running": false, "at": "2026-01-01T00:00:00Z", "since": hostile,
        "done": {"delivered": 0, "learned": 0, "rejected": 0, "delivered_last_hour": 0, "rejected_last_hour": 0},
        "under_way": [], "waiting": {"count": 0, "first": []}, "incomplete": {"count": 0, "first": []},
        "outdated": {"count": 0, "first": []},
        "finished": [
            finished("real.dxf", "can", "real.dxf"),
            finished(hostile, "can", hostile),
            finished("plain", "can", "b<i>'.dxf"),
            finished("up", "can", "../../secret"),
            finished("away", "..", "secret"),
            finished("real.dxf", "can", "real.dxf"),
        ],
        "rejections": [{"at": hostile, "drop": hostile, "reason": {"code": hostile, "what": hostile, "remedy": hostile}}],
    });
    station.desk.write("state/status.json", status.to_string());
    let mut settings = station.desk.text("station.toml");
    settings = settings.replace("name = \"test\"", "name = \"</title><script>alert(2)</script>\"");
    station.desk.write("station.toml", settings);
    if cfg!(unix) {
        station.desk.write("hot/a<script>alert(3)<.dxf", "x");
        station.desk.write("hot/b'&@\"onload=.dxf", "x");
    }
    let shown = Shown::of(station, &["--page", "127.0.0.1:0"]);
    let words: &[&str] = if cfg!(unix) {
        &["a&lt;script&gt;alert(3)&lt;.dxf was rejected", "b&#39;&amp;@&quot;onload=.dxf was"]
    } else {
        &[]
    };
    let page = shown.page_with(&[&["real.dxf: Delivered"], words].concat());
    assert_eq!((page.matches("<script").count(), page.matches("</title").count()), (1, 1), "{page}");
    assert!(!page.contains("alert(1)</script>") && !page.contains('\u{202e}'), "{page}");
    for attribute in ["onload", "onerror", "style", "onclick"] {
        assert!(attributes(&page, attribute).is_empty(), "{attribute} in {page}");
    }
    // One picture and one report, of the newest drawing of its name.
    let links: BTreeSet<_> =
        attributes(&page, "href").into_iter().filter(|link| link.starts_with("/picture/")).collect();
    assert_eq!(links.len(), 2, "the real one, and one with a strange but plain name: {links:?}");
    let found: Vec<u16> = links.iter().map(|link| shown.get(link).code).collect();
    assert_eq!(found.iter().filter(|code| **code == 200).count(), 1, "{found:?}");
    for path in [
        "/picture/../../secret.preview.svg",
        "/picture/..%2f..%2fsecret.preview.svg",
        "/picture/real.dxf.preview.svg",
        "/picture/.svg",
        "/report/..\\..\\secret.html",
        "/report//etc/passwd.html",
        "/station.toml",
        "/../station.toml",
        "//state/status.json",
        "/picture/%00.svg",
        "/events/../station.toml",
    ] {
        let reply = shown.get(path);
        assert!([400, 404].contains(&reply.code) && !reply.text().contains("secret\""), "{path}: {reply:?}");
        assert!(!reply.text().contains("a secret"), "{path}");
    }
    #[cfg(unix)]
    {
        // A link that leads out of the reports folder is not followed.
        let report = shown.station.path("reports/can/real.dxf.preview.svg");
        std::fs::remove_file(&report).unwrap();
        std::os::unix::fs::symlink(shown.station.path("secret.preview.svg"), &report).unwrap();
        assert!(links.iter().all(|link| shown.get(link).code == 404));
    }
}

/// How many of the connections the page has not closed.
fn open(streams: &mut [TcpStream]) -> usize {
    let mut bytes = [0; 1024];
    let mut is_open = |stream: &mut TcpStream| {
        stream.set_nonblocking(true).unwrap();
        loop {
            match stream.read(&mut bytes) {
                Ok(0) => return false,
                Ok(_) => {}
                Err(error) => return error.kind() == ErrorKind::WouldBlock,
            }
        }
    };
    streams.iter_mut().filter_map(|stream| is_open(stream).then_some(())).count()
}

#[test]
fn slow_clients_delay_no_delivery_and_their_number_is_bounded() {
    let shown = Shown::new();
    shown.station.desk.write("hot/trough.obj", PART);
    shown.station.waits_for_empty_hot();
    let host = shown.at;
    // Many send half a request, and some never read the events that they asked for.
    let mut deaf: Vec<TcpStream> = Vec::new();
    let mut slow: Vec<TcpStream> = Vec::new();
    for index in 0..200 {
        if index < 50 {
            let mut stream = shown.connect();
            write!(stream, "GET /events HTTP/1.1\r\nHost: {host}\r\n\r\n").unwrap();
            deaf.push(stream);
        }
        let mut stream = shown.connect();
        let _ = write!(stream, "GET / HTTP/1.1\r\nHost: {host}\r\nX-Slow: ");
        slow.push(stream);
        // One drawing after the other is delivered while they hang.
        if index % 50 == 10 {
            let name = format!("trough@{index}.dxf");
            shown.station.copy_into(&drawing("square"), &name);
            shown.station.waits_for_file(&format!("import/{name}"));
        }
    }
    // Others still get the page.
    let page = shown.page_with(&["trough@160.dxf: Delivered"]);
    assert!(page.contains("<p class=\"word\">Ready</p>"), "{page}");
    let started = Instant::now();
    while open(&mut slow) > BOUND {
        assert!(started.elapsed() < LIMIT, "{} of 200 are open", open(&mut slow));
        std::thread::sleep(Duration::from_millis(20));
    }
    assert!(open(&mut deaf) <= BOUND);
    // Later the page closes all that send nothing more.
    let started = Instant::now();
    while open(&mut slow) > 0 {
        assert!(started.elapsed() < LIMIT, "{} never ask", open(&mut slow));
        std::thread::sleep(Duration::from_millis(50));
    }
    shown.station.copy_into(&drawing("square"), "trough@last.dxf");
    shown.station.waits_for_file("import/trough@last.dxf");
    assert!(!shown.station.log().contains("panicked"), "{}", shown.station.log());
}

/// Requests whose form never arrives have asked nothing: others get their place.
#[test]
fn forms_that_never_arrive_keep_nobody_out() {
    let shown = Shown::new();
    let mut held: Vec<TcpStream> = Vec::new();
    for _ in 0..100 {
        let mut stream = shown.connect();
        let head = "Content-Type: application/x-www-form-urlencoded\r\nContent-Length: 100";
        let _ = write!(
            stream,
            "POST /retry HTTP/1.1\r\nHost: {0}\r\nOrigin: http://{0}\r\n{head}\r\n\r\n",
            shown.at
        );
        held.push(stream);
    }
    assert!(shown.page_with(&["<p class=\"word\">Ready</p>"]).contains("<h1>"));
    let started = Instant::now();
    while open(&mut held) > BOUND {
        assert!(started.elapsed() < LIMIT, "{} of 100 are open", open(&mut held));
        std::thread::sleep(Duration::from_millis(20));
    }
}

/// To open a pipe waits until somebody writes into it.
#[cfg(target_os = "linux")]
#[test]
fn a_file_that_hangs_holds_no_button() {
    let shown = Shown::new();
    shown.station.desk.write("hot/trough.obj", PART);
    shown.station.copy_into(&drawing("square"), "trough.dxf");
    shown.station.waits_for_file("reports/trough/trough.dxf.preview.svg");
    let page = shown.page_with(&["trough.dxf: Delivered", "/picture/"]);
    let picture = page.split("/picture/").nth(1).unwrap().split(['"', '#']).next().unwrap().to_owned();
    let file = shown.station.path("reports/trough/trough.dxf.preview.svg");
    std::fs::remove_file(&file).unwrap();
    assert!(Command::new("mkfifo").arg(&file).status().unwrap().success());
    for _ in 0..6 {
        assert_eq!(shown.get(&format!("/picture/{picture}")).code, 404);
    }
    shown.station.desk.write("hot/trough@bad.dxf", "%PDF");
    let page = shown.page_with(&["aria-label=\"Retry trough@bad.dxf\""]);
    assert!(page.contains("trough@bad.dxf"));
}

#[test]
fn other_computers_need_a_setting_and_a_password() {
    let station = Station::new();
    let settings = station.desk.text("station.toml");
    let watch = |page: &str, arguments: &[&str]| {
        station.desk.write("station.toml", format!("{settings}{page}"));
        station.desk.isomark(&[&["watch", "station.toml"], arguments].concat())
    };
    for (page, arguments, words) in [
        ("", vec!["--page", "0.0.0.0:0"], "At 0.0.0.0:0 other computers could open the page."),
        ("", vec!["--page", "[::]:0"], "At [::]:0 other computers could open the page."),
        ("", vec!["--page", "192.0.2.7:4780"], "At 192.0.2.7:4780 other computers could open the page."),
        ("[page]\naddress = \"0.0.0.0:0\"\nother_computers = true\n", vec![], "At 0.0.0.0:0 other"),
        ("[page]\naddress = \"0.0.0.0:0\"\npassword_file = \"p\"\n", vec![], "At 0.0.0.0:0 other"),
        (
            "[page]\naddress = \"127.0.0.1:0\"\nnames = [\"laser1\"]\n",
            vec![],
            "lets other computers open the page",
        ),
        (
            "[page]\nother_computers = true\npassword_file = \"p\"\nnames = [\"a/b\"]\n",
            vec![],
            "`a/b` in `page.names`",
        ),
        ("[page]\npassword_file = \"p\"\npassword_variable = \"P\"\n", vec![], "both give the password"),
        ("", vec!["--page", "127.0.0.1"], "is not an address for the page"),
        ("", vec!["--page", "localhost.evil:80"], "is not an address for the page"),
        ("", vec!["--page", "127.0.0.1.evil.com:80"], "is not an address for the page"),
        ("", vec!["--page", "127.0.0.1:99999"], "is not an address for the page"),
    ] {
        let output = watch(page, &arguments);
        output.refused(2, &[words, "what to do: "]);
    }
    let output = station.desk.isomark(&["watch", "station.toml", "--once", "--page"]);
    assert_eq!(output.code, 2, "{output:?}");
}

fn basic(password: &str) -> String {
    format!("Basic {}", STANDARD.encode(format!("anybody:{password}")))
}

#[test]
fn a_password_is_needed_and_shown_nowhere() {
    let station = Station::new();
    let settings = station.desk.text("station.toml");
    let page = "[page]\naddress = \"0.0.0.0:0\"\nother_computers = true\npassword_file = \"pass.txt\"\nnames = [\"laser1.shop\"]\n";
    station.desk.write("station.toml", settings + page);
    station.desk.write("pass.txt", "correct horse battery\n");
    let shown = Shown::of(station, &[]);
    let enter = |password: &str| shown.ask("GET", "/", &[("Authorization", &basic(password))], "");
    for path in ["/", "/events", "/picture/x.svg", "/nothing"] {
        let reply = shown.get(path);
        assert_eq!(reply.code, 401, "{reply:?}");
        assert!(reply.header("www-authenticate").unwrap().starts_with("basic realm="), "{reply:?}");
        assert!(!reply.text().contains("Newest drops"));
    }
    assert_eq!(shown.post("/retry", "x", "y").code, 401);
    assert_eq!(enter("correct horse batter").code, 401);
    let page = enter("correct horse battery");
    assert_eq!(page.code, 200);
    assert_eq!(
        shown
            .ask(
                "GET",
                "/",
                &[("Host", "laser1.shop"), ("Authorization", &basic("correct horse battery"))],
                ""
            )
            .code,
        200
    );
    assert_eq!(
        shown
            .ask(
                "GET",
                "/",
                &[("Host", "laser2.shop"), ("Authorization", &basic("correct horse battery"))],
                ""
            )
            .code,
        421
    );
    // Guessing is slow, and the right password is not checked while its sender is blocked.
    let mut codes = BTreeSet::new();
    for guess in 0..20 {
        codes.insert(enter(&format!("guess {guess}")).code);
    }
    assert_eq!(codes, [401, 429].into());
    let reply = enter("correct horse battery");
    assert_eq!(reply.code, 429);
    assert!(reply.header("retry-after").unwrap().parse::<u64>().unwrap() > 0);
    let station = &shown.station;
    for text in [station.log(), station.desk.text("state/status.json"), page.text()] {
        assert!(!text.contains("correct horse") && !text.contains("guess 1"), "{text}");
    }
    assert!(station.log().contains("wrong passwords for the page"), "{}", station.log());
}

#[test]
fn a_page_that_cannot_open_stops_no_delivery_and_opens_later() {
    let taken = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = taken.local_addr().unwrap().to_string();
    let mut station = Station::new();
    let settings = station.desk.text("station.toml");
    station.desk.write("station.toml", format!("{settings}[page]\npassword_file = \"pass.txt\"\n"));
    station.start_with(&["--page", &address]);
    station.desk.write("hot/trough.obj", PART);
    station.copy_into(&drawing("square"), "trough.dxf");
    station.waits_for_file("import/trough.dxf");
    let troubled = |words: &str| {
        let words = words.to_owned();
        move |station: &Station| {
            let status = station.desk.isomark(&["status", "station.toml", "--json"]);
            let status: Value = serde_json::from_str(&status.out).unwrap();
            let first = status["troubles"].as_array().and_then(|all| all.first()).and_then(Value::as_str);
            first.map_or(words.is_empty(), |trouble| !words.is_empty() && trouble.contains(&words))
        }
    };
    station.waits_for("no password", troubled("pass.txt of the page cannot be read"));
    station.desk.write("pass.txt", "short");
    station.waits_for("a short password", troubled("is too short"));
    station.desk.write("pass.txt", "long enough");
    station.waits_for("a taken port", troubled(&format!("cannot be opened at {address}")));
    assert!(station.log().contains("Stop the program that uses this address"), "{}", station.log());
    drop(taken);
    station.waits_for("the page", |station| station.log().contains("the page of the station is at http://"));
    station.waits_for("no trouble", troubled(""));
    assert!(!station.log().contains("long enough") && !station.log().contains("panicked"));
}

#[test]
fn a_changed_page_takes_effect_after_a_restart() {
    let shown = Shown::new();
    let settings = shown.station.desk.text("station.toml");
    // The command line still gives the address.
    shown.station.desk.write("station.toml", format!("{settings}[page]\npassword_file = \"pass.txt\"\n"));
    shown
        .station
        .waits_for("a warning", |station| station.log().contains("`page` takes effect after a restart"));
    assert_eq!(shown.get("/").code, 200);
}

#[test]
fn garbage_is_refused_and_the_page_lives_on() {
    let shown = Shown::new();
    let host = shown.at;
    let valid = format!(
        "POST /retry HTTP/1.1\r\nHost: {host}\r\nContent-Type: application/x-www-form-urlencoded\r\nContent-Length: 9\r\n\r\ntoken=a&k"
    );
    let mut requests: Vec<Vec<u8>> = vec![
        b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n".to_vec(),
        b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03".to_vec(),
        b"GET / HTTP/1.1\r\n\r\n".to_vec(),
        b"GET / HTTP/1.0\r\n\r\n".to_vec(),
        b"GET * HTTP/1.1\r\nHost: x\r\n\r\n".to_vec(),
        format!("CONNECT {host} HTTP/1.1\r\nHost: {host}\r\n\r\n").into(),
        format!("GET / HTTP/1.1\r\nHost: {host}\r\n{}\r\n", "A: b\r\n".repeat(5000)).into(),
        format!("GET /{} HTTP/1.1\r\nHost: {host}\r\n\r\n", "x".repeat(100_000)).into(),
        format!("GET / HTTP/1.1\r\nHost: {host}\r\nCookie: {}\r\n\r\n", "x".repeat(100_000)).into(),
        format!("POST /retry HTTP/1.1\r\nHost: {host}\r\nContent-Type: application/x-www-form-urlencoded\r\nTransfer-Encoding: chunked\r\n\r\nffffffffffffffff\r\nx").into(),
        format!("POST /retry HTTP/1.1\r\nHost: {host}\r\nContent-Type: application/x-www-form-urlencoded\r\nContent-Length: 99999999999999999999\r\n\r\n").into(),
        format!("POST /retry HTTP/1.1\r\nHost: {host}\r\nContent-Length: 5\r\nTransfer-Encoding: chunked\r\n\r\n0\r\n\r\n").into(),
        format!("GET /%ff%fe HTTP/1.1\r\nHost: {host}\r\nAuthorization: Basic \u{ff}\r\nAccept: \u{ff}\r\n\r\n").into(),
        valid.replace("token=a&k", "\u{fff}\u{fff}===").into(),
    ];
    // A fixed sequence of changes to a valid request (Marsaglia, "Xorshift RNGs", 2003).
    let mut state = 0x2545_f491_4f6c_dd1d_u64;
    let mut random = |below: usize| {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state % below as u64) as usize
    };
    for _ in 0..300 {
        let mut bytes = valid.clone().into_bytes();
        for _ in 0..1 + random(6) {
            let at = random(bytes.len());
            match random(4) {
                0 => bytes[at] = random(256) as u8,
                1 if bytes.len() > 1 => drop(bytes.remove(at)),
                2 => bytes.insert(at, random(256) as u8),
                _ => bytes.truncate(at.max(1)),
            }
        }
        requests.push(bytes);
    }
    for request in requests {
        let mut stream = shown.connect();
        let _ = stream.write_all(&request);
        // Half a request gets its answer only when the sender stops.
        let _ = stream.shutdown(std::net::Shutdown::Write);
        let mut answer = Vec::new();
        let _ = stream.read_to_end(&mut answer);
        let head = String::from_utf8_lossy(&answer[..answer.len().min(12)]).into_owned();
        let is_refused = head.is_empty() || head.starts_with("HTTP/1.1 4") || head.starts_with("HTTP/1.0 4");
        assert!(is_refused, "{head} to {:?}", String::from_utf8_lossy(&request));
    }
    let log = shown.station.log();
    assert!(!log.contains("panicked") && !log.contains("internal error"), "{log}");
    assert!(shown.page().contains("Ready"));
}

#[test]
fn the_page_ends_with_its_station() {
    let mut shown = Shown::new();
    let mut events = shown.events();
    shown.station.kill();
    let mut rest = Vec::new();
    // A killed program closes its connections.
    let _ = events.stream.read_to_end(&mut rest);
    #[cfg(unix)]
    {
        let shown = Shown::of(Station::new(), &["--page", "127.0.0.1:0"]);
        let mut events = shown.events();
        let process = shown.station.running.as_ref().unwrap().id().to_string();
        assert!(Command::new("kill").args(["-TERM", &process]).status().unwrap().success());
        events.until("Stopped");
        shown.station.waits_for("the end", |station| station.log().contains(" stopped; no drop waits"));
    }
}

#[test]
fn the_page_works_in_a_real_browser() {
    let Some(axe) = browser::axe() else { return };
    let shown = with_three_drops();
    shown.page_with(&["trough@date.dxf: Delivered", "aria-label=\"Retry trough@broken.dxf\""]);
    let mut command = Command::new("python3");
    command.args(["-B", "tests/browser/page.py"]).arg(axe).arg(format!("http://{}/", shown.at));
    command.arg(shown.station.running.as_ref().unwrap().id().to_string());
    command.arg(shown.station.path("hot")).arg(drawing("square"));
    // `ISOMARK_SCREENSHOTS` names a folder for pictures of what the test saw.
    command.args(std::env::var_os("ISOMARK_SCREENSHOTS"));
    let output = command.output().unwrap();
    assert!(
        output.status.success(),
        "{}{}\n{}",
        String::from_utf8_lossy(&output.stdout),
        String::from_utf8_lossy(&output.stderr),
        shown.station.log()
    );
    // Both retries rejected the drawing again; the station may have been killed during the second one.
    let is_in = |folder: &str| shown.station.path(folder).join("trough@broken.dxf").exists();
    assert!(is_in("rejected") || is_in("hot"));
}
