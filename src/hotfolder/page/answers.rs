//! Requests to answers.

use std::convert::Infallible;
use std::future::poll_fn;
use std::net::{IpAddr, SocketAddr};
use std::pin::Pin;
use std::rc::Rc;
use std::sync::Arc;
use std::task::{Context, Poll};
use std::time::{Duration, Instant};

use hyper::body::{Body, Bytes, Frame, Incoming, SizeHint};
use hyper::header::{
    ACCEPT, ALLOW, CACHE_CONTROL, CONTENT_SECURITY_POLICY, CONTENT_TYPE, HeaderName, HeaderValue, LOCATION,
    REFERRER_POLICY, RETRY_AFTER, WWW_AUTHENTICATE, X_CONTENT_TYPE_OPTIONS,
};
use hyper::{Method, Request, Response, StatusCode};
use serde_json::json;
use tokio::sync::{OwnedSemaphorePermit, mpsc};
use tokio::task::{spawn_blocking, spawn_local};
use tokio::time::timeout;

use super::access::Refusal;
use super::board::{Board, Desk, Either, either};
use super::records::{self, NotSent};
use super::socket::Limits;
use crate::hotfolder::api::PictureKind;
use crate::reason::Reason;

/// How long the rest of a request and the work on it may take.
const WORK: Duration = Duration::from_secs(20);
/// How long a request for a file waits for its turn.
const READING: Duration = Duration::from_secs(5);
/// How long an answer may take, and in addition for each of its bytes: 50 kB/s.
const SENDING: Duration = Duration::from_secs(20);
const SENDING_BYTE: Duration = Duration::from_micros(20);
/// The largest body of a request, bytes: two keys.
const LARGEST_BODY: usize = 1024;
/// After this time without news, an event shows that the station is alive.
const BEAT: Duration = Duration::from_secs(10);

const HTML: &str = "text/html; charset=utf-8";
/// A picture shows itself, and nothing else.
const PICTURE_POLICY: &str = "default-src 'none'; style-src 'unsafe-inline'; frame-ancestors 'none'; sandbox";
/// A report has its own policy, which allows only its own script. This one allows all scripts in it and
/// removes all other rights, also the same origin as the page: a report that was replaced cannot press a
/// button.
const REPORT_POLICY: &str = "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data:; \
                             base-uri 'none'; form-action 'none'; frame-ancestors 'none'; sandbox allow-scripts";

/// A connection, as answers need it.
#[derive(Clone)]
pub(super) struct Client {
    pub(super) sender: IpAddr,
    pub(super) local: SocketAddr,
    pub(super) limits: Rc<Limits>,
}

/// The body of an answer.
pub(super) enum Content {
    /// Bytes, and the memory that they take.
    Whole(Option<Bytes>, Option<OwnedSemaphorePermit>),
    /// Events, each when it is ready.
    Events(
        mpsc::Receiver<Bytes>,
        #[expect(dead_code, reason = "held as long as the stream")] OwnedSemaphorePermit,
    ),
}

impl Body for Content {
    type Data = Bytes;
    type Error = Infallible;

    fn poll_frame(
        self: Pin<&mut Self>,
        cx: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, Infallible>>> {
        match self.get_mut() {
            Self::Whole(bytes, _) => Poll::Ready(bytes.take().map(|bytes| Ok(Frame::data(bytes)))),
            Self::Events(events, _) => {
                events.poll_recv(cx).map(|event| event.map(|event| Ok(Frame::data(event))))
            }
        }
    }

    fn is_end_stream(&self) -> bool {
        matches!(self, Self::Whole(None, _))
    }

    fn size_hint(&self) -> SizeHint {
        match self {
            Self::Whole(bytes, _) => SizeHint::with_exact(bytes.as_ref().map_or(0, Bytes::len) as u64),
            Self::Events(..) => SizeHint::default(),
        }
    }
}

type Answer = Response<Content>;

/// Why there is no other answer.
struct Problem {
    status: StatusCode,
    title: &'static str,
    text: String,
    remedy: String,
    header: Option<(HeaderName, HeaderValue)>,
}

impl Problem {
    fn new(
        status: StatusCode,
        title: &'static str,
        text: impl Into<String>,
        remedy: impl Into<String>,
    ) -> Self {
        Self { status, title, text: text.into(), remedy: remedy.into(), header: None }
    }

    fn with(mut self, name: HeaderName, value: HeaderValue) -> Self {
        self.header = Some((name, value));
        self
    }

    fn missing() -> Self {
        Self::new(
            StatusCode::NOT_FOUND,
            "Not found",
            "There is no such page.",
            "Open the page of the station.",
        )
    }

    fn busy(text: &str) -> Self {
        let problem = Self::new(StatusCode::SERVICE_UNAVAILABLE, "Busy", text, "Try again in a moment.");
        problem.with(RETRY_AFTER, HeaderValue::from_static("5"))
    }
}

impl From<Refusal> for Problem {
    fn from(refusal: Refusal) -> Self {
        match refusal {
            Refusal::NoHost => Self::new(
                StatusCode::BAD_REQUEST,
                "Bad request",
                "The request names no host, one that cannot be understood, or several.",
                "Use a web browser.",
            ),
            Refusal::OtherHost => Self::new(
                StatusCode::MISDIRECTED_REQUEST,
                "Another host",
                "The address names a host that is not this computer.",
                "Use the address in the log of the station. Enter other names of this computer as `names` under [page].",
            ),
            Refusal::OtherOrigin => Self::new(
                StatusCode::FORBIDDEN,
                "Another page",
                "The request comes from another page. Nothing was done.",
                "Use the buttons of the page of the station.",
            ),
            Refusal::NoPassword => {
                let text = "The page of the station needs its password.";
                let problem = Self::new(
                    StatusCode::UNAUTHORIZED,
                    "Password",
                    text,
                    "Reload the page, and enter the password.",
                );
                problem.with(
                    WWW_AUTHENTICATE,
                    HeaderValue::from_static("Basic realm=\"isomark station\", charset=\"UTF-8\""),
                )
            }
            Refusal::Blocked(wait) => {
                let seconds = wait.as_secs() + 1;
                let text = "This computer sent too many wrong passwords.";
                let problem = Self::new(
                    StatusCode::TOO_MANY_REQUESTS,
                    "Wait",
                    text,
                    format!("Wait {seconds} s, then enter the right password."),
                );
                problem.with(RETRY_AFTER, HeaderValue::from(seconds))
            }
        }
    }
}

/// Answers a request.
pub(super) async fn answer(
    desk: Rc<Desk>,
    client: Client,
    request: Request<Incoming>,
) -> Result<Answer, Infallible> {
    // The rest of a form may still be on its way: until it is here, the client has asked nothing.
    if request.method() != Method::POST {
        client.limits.allow(Some(WORK));
    }
    let is_for_script = request.headers().get(ACCEPT).is_some_and(|accept| accept == "application/json");
    let answer =
        respond(&desk, &client, request).await.unwrap_or_else(|problem| shown(&desk, problem, is_for_script));
    client.limits.allow(match answer.body() {
        Content::Whole(bytes, _) => {
            let bytes = bytes.as_ref().map_or(0, Bytes::len);
            Some(SENDING + SENDING_BYTE * u32::try_from(bytes).unwrap_or(u32::MAX))
        }
        Content::Events(..) => None,
    });
    Ok(answer)
}

async fn respond(desk: &Rc<Desk>, client: &Client, request: Request<Incoming>) -> Result<Answer, Problem> {
    let (parts, body) = request.into_parts();
    // A request to a proxy names a host of its own.
    if parts.uri.authority().is_some() {
        return Err(Refusal::NoHost.into());
    }
    let host = desk.access.borrow().host(&parts.headers, client.local)?;
    desk.access.borrow_mut().entry(&parts.headers, client.sender, Instant::now())?;
    let path = parts.uri.path();
    let allowed = match path {
        "/retry" | "/deliver-again" => Method::POST,
        _ => Method::GET,
    };
    if parts.method != allowed {
        let text = format!("This address accepts only {allowed}. Nothing was done.");
        let problem =
            Problem::new(StatusCode::METHOD_NOT_ALLOWED, "Not allowed", text, "Use the buttons of the page.");
        let allow = if allowed == Method::POST { "POST" } else { "GET" };
        return Err(problem.with(ALLOW, HeaderValue::from_static(allow)));
    }
    if allowed == Method::POST {
        desk.access.borrow().origin(&parts.headers, &host)?;
        let is_form = |kind: &HeaderValue| kind.as_bytes().starts_with(b"application/x-www-form-urlencoded");
        if !parts.headers.get(CONTENT_TYPE).is_some_and(is_form) {
            let text = "The request is not a form of the page. Nothing was done.";
            return Err(Problem::new(
                StatusCode::UNSUPPORTED_MEDIA_TYPE,
                "Not a form",
                text,
                "Use the buttons of the page.",
            ));
        }
        let is_for_script = parts.headers.get(ACCEPT).is_some_and(|accept| accept == "application/json");
        return act(desk, client, path, body, is_for_script).await;
    }
    match path {
        "/" => Ok(page(desk, parts.uri.query())),
        "/events" => events(desk),
        _ => file(desk, path).await,
    }
}

/// The page itself.
fn page(desk: &Desk, query: Option<&str>) -> Answer {
    desk.visit();
    let done = query.and_then(|query| query.strip_prefix("done=")).and_then(records::text_of);
    let board = Arc::clone(&desk.board.borrow());
    let html = desk.frame.page(&board.content, &board.station, &desk.version, done);
    whole(StatusCode::OK, HTML, &desk.frame.policy, html.into())
}

/// The stream of events. A client that reads slowly gets the newest state when it is ready for it, and nothing in between.
fn events(desk: &Rc<Desk>) -> Result<Answer, Problem> {
    let full = |_| Problem::busy("Too many browsers show the page live.");
    let permit = Arc::clone(&desk.streams).try_acquire_owned().map_err(full)?;
    let (sender, receiver) = mpsc::channel(1);
    let (desk, mut board) = (Rc::clone(desk), desk.board.subscribe());
    spawn_local(async move {
        let mut sent: Option<Arc<Board>> = None;
        while let Ok(place) = sender.reserve().await {
            desk.visit();
            let now = Arc::clone(&board.borrow_and_update());
            place.send(desk.event(sent.as_deref(), &now));
            if now.is_last {
                return;
            }
            sent = Some(now);
            // Without news, the next event is empty.
            if let Either::Other(()) = either(timeout(BEAT, board.changed()), sender.closed()).await {
                return;
            }
        }
    });
    let policy = HeaderValue::from_static("default-src 'none'; frame-ancestors 'none'");
    let mut answer = Response::new(Content::Events(receiver, permit));
    answer.headers_mut().insert(CONTENT_TYPE, HeaderValue::from_static("text/event-stream"));
    answer.headers_mut().insert(CONTENT_SECURITY_POLICY, policy);
    protect(&mut answer);
    Ok(answer)
}

/// A picture or a report of a listed drawing.
async fn file(desk: &Desk, path: &str) -> Result<Answer, Problem> {
    let named = |start: &str, end: &str| path.strip_prefix(start).and_then(|rest| rest.strip_suffix(end));
    let (key, kind, mime, policy) = match (named("/picture/", ".svg"), named("/report/", ".html")) {
        (Some(key), _) => (key, PictureKind::Preview, "image/svg+xml", PICTURE_POLICY),
        (_, Some(key)) => (key, PictureKind::Page, HTML, REPORT_POLICY),
        (None, None) => return Err(Problem::missing()),
    };
    let board = Arc::clone(&desk.board.borrow());
    let Some((record, seen)) = board.content.records.get(key).cloned().zip(board.seen.clone()) else {
        return Err(Problem::missing());
    };
    let room = Arc::clone(&desk.room);
    // A disk that does not answer holds only these readers: buttons have others.
    let busy = |_| Problem::busy("The reports folder does not answer, or too many files are being read.");
    let turn = timeout(READING, Arc::clone(&desk.reading).acquire_owned()).await.map_err(busy)?;
    let read = spawn_blocking(move || {
        let _turn = turn;
        record.read(&seen.folders, kind, &room)
    });
    let read = read.await;
    let (bytes, permit) = read.unwrap_or(Err(NotSent::Missing)).map_err(|error| match error {
        NotSent::Missing => Problem::new(
            StatusCode::NOT_FOUND,
            "Not found",
            "The file was removed, or could not be drawn.",
            "Look into the reports folder of the station.",
        ),
        NotSent::TooLarge => Problem::new(
            StatusCode::PAYLOAD_TOO_LARGE,
            "Too large",
            "The file is too large for the page.",
            "Open it in the reports folder of the station.",
        ),
        NotSent::Busy => Problem::busy("Too many files are being sent."),
    })?;
    let mut answer = whole(StatusCode::OK, mime, policy, bytes);
    if let Content::Whole(_, room) = answer.body_mut() {
        *room = Some(permit);
    }
    if kind == PictureKind::Preview {
        // A later picture of the same name has another key.
        answer.headers_mut().insert(CACHE_CONTROL, HeaderValue::from_static("private, max-age=600"));
    }
    Ok(answer)
}

/// Does what a button of the page is for.
async fn act(
    desk: &Desk,
    client: &Client,
    path: &str,
    body: Incoming,
    is_for_script: bool,
) -> Result<Answer, Problem> {
    let form = form(body).await?;
    client.limits.allow(Some(WORK));
    let asked = Instant::now();
    let field = |name: &str| {
        let mut fields =
            form.split('&').filter_map(|field| field.split_once('=')).filter(|(key, _)| *key == name);
        fields.next().map(|(_, value)| value).filter(|_| fields.next().is_none())
    };
    if !field("token").is_some_and(|token| desk.access.borrow().secrets().is_token(token)) {
        let text = "The page is from an earlier start of the station. Nothing was done.";
        return Err(Problem::new(
            StatusCode::FORBIDDEN,
            "Outdated page",
            text,
            "Reload the page, and press the button again.",
        ));
    }
    let board = Arc::clone(&desk.board.borrow());
    let action = field("key")
        .and_then(|key| board.content.actions.get(key))
        .filter(|action| action.path() == path)
        .cloned();
    let Some((action, seen)) = action.zip(board.seen.clone()) else {
        let text = "The station has changed since: the button has no meaning now. Nothing was done.";
        return Err(Problem::new(StatusCode::CONFLICT, "Outdated page", text, "Reload the page."));
    };
    let _turn = desk.acting.acquire().await;
    // If a disk answers late, the client has been refused: then nothing may be done any more.
    let perform = move || match asked.elapsed() < WORK {
        true => action.perform(&seen),
        false => Err(Reason::new(
            "environment",
            "The disk did not answer in time. Nothing was done.",
            "Try again.",
        )),
    };
    let done = spawn_blocking(perform).await;
    desk.look_again();
    let done = match done {
        Ok(Ok(done)) => done,
        Ok(Err(reason)) => {
            return Err(Problem::new(StatusCode::CONFLICT, "Not done", reason.what, reason.remedy));
        }
        Err(_) => {
            let text = "An internal error stopped the request.";
            return Err(Problem::new(StatusCode::INTERNAL_SERVER_ERROR, "Not done", text, "Report this."));
        }
    };
    if is_for_script {
        return Ok(json_answer(StatusCode::OK, &done.text));
    }
    let mut answer = whole(StatusCode::SEE_OTHER, HTML, &desk.frame.policy, Vec::new());
    if let Ok(location) = HeaderValue::from_str(&format!("/?done={}", done.word)) {
        answer.headers_mut().insert(LOCATION, location);
    }
    Ok(answer)
}

/// The body of a form. Its fields are keys of letters and digits, so nothing is decoded.
async fn form(mut body: Incoming) -> Result<String, Problem> {
    let bad = || {
        let text = "The form is not one of the page. Nothing was done.";
        Problem::new(StatusCode::BAD_REQUEST, "Bad request", text, "Use the buttons of the page.")
    };
    let mut bytes = Vec::new();
    while let Some(frame) = poll_fn(|cx| Pin::new(&mut body).poll_frame(cx)).await {
        let data = frame.ok().and_then(|frame| frame.into_data().ok()).ok_or_else(bad)?;
        if bytes.len() + data.len() > LARGEST_BODY {
            let text = "The form is too large. Nothing was done.";
            return Err(Problem::new(
                StatusCode::PAYLOAD_TOO_LARGE,
                "Too large",
                text,
                "Use the buttons of the page.",
            ));
        }
        bytes.extend_from_slice(&data);
    }
    String::from_utf8(bytes).map_err(|_| bad())
}

fn shown(desk: &Desk, problem: Problem, is_for_script: bool) -> Answer {
    let Problem { status, title, text, remedy, header } = problem;
    let mut answer = match is_for_script {
        true => json_answer(status, &format!("{text} {remedy}")),
        false => whole(status, HTML, &desk.frame.policy, desk.frame.message(title, &text, &remedy).into()),
    };
    if let Some((name, value)) = header {
        answer.headers_mut().insert(name, value);
    }
    answer
}

fn json_answer(status: StatusCode, text: &str) -> Answer {
    let json = json!({ "text": text }).to_string();
    whole(status, "application/json", "default-src 'none'; frame-ancestors 'none'", json.into())
}

fn whole(status: StatusCode, mime: &'static str, policy: &str, bytes: Vec<u8>) -> Answer {
    let mut answer = Response::new(Content::Whole(Some(bytes.into()), None));
    *answer.status_mut() = status;
    answer.headers_mut().insert(CONTENT_TYPE, HeaderValue::from_static(mime));
    if let Ok(policy) = HeaderValue::from_str(policy) {
        answer.headers_mut().insert(CONTENT_SECURITY_POLICY, policy);
    }
    protect(&mut answer);
    answer
}

/// The headers of every answer. `Referrer-Policy: no-referrer` would also take the origin from the forms.
fn protect(answer: &mut Answer) {
    for (name, value) in [
        (X_CONTENT_TYPE_OPTIONS, "nosniff"),
        (REFERRER_POLICY, "same-origin"),
        (CACHE_CONTROL, "no-store"),
        (HeaderName::from_static("cross-origin-resource-policy"), "same-origin"),
        (HeaderName::from_static("cross-origin-opener-policy"), "same-origin"),
        (HeaderName::from_static("x-frame-options"), "DENY"),
    ] {
        answer.headers_mut().insert(name, HeaderValue::from_static(value));
    }
}
