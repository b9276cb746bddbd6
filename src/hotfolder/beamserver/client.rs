//! The commands of BeamServer, in one session at a time.

use std::io::{ErrorKind, Read, Write};
use std::net::{TcpStream, ToSocketAddrs};
use std::time::{Duration, Instant};

use crate::config::DeliverySettings;
use crate::hotfolder::api::JobError;
use crate::hotfolder::seen::StopSignal;
use crate::reason::Reason;

const CONNECT: Duration = Duration::from_secs(3);
/// How often a thread that waits for an answer checks whether the station is stopping.
const LOOK: Duration = Duration::from_millis(50);
/// How long a session may still take when the station is stopping: a working server needs less.
const STOP_GRACE: Duration = Duration::from_secs(2);
/// The longest session, as a multiple of the time for one answer.
const MAX_ANSWERS: u32 = 60;
/// The largest number of elements in a project; a server that lists more is broken.
const MAX_ELEMENTS: usize = 100_000;
/// The longest answer, bytes.
const MAX_ANSWER: usize = 4096;
/// The unit of sizes is 1/10000 mm.
const PER_MILLIMETRE: f64 = 10_000.0;
/// The tolerance for the size, mm: the importer works in whole micrometres, at both ends of the drawing.
const SIZE_TOLERANCE: f64 = 0.01;
/// BeamServer's first number for an element that does not exist.
const NO_SUCH_ELEMENT: i64 = 7;
/// Its first number for an invalid index.
const BAD_INPUT: i64 = 16;
/// Its first numbers for a file that cannot be opened or read.
const UNREADABLE_FILE: [i64; 2] = [19, 21];
const CHECK_THE_SERVER: &str = "Check that `delivery.address` is the address of BeamServer, and restart BeamServer; isomark tries again. \
                                If the answer stays like this, report it with the version of BeamConstruct.";

/// Why a session ended early.
pub(crate) enum SessionError {
    /// The server cannot be reached, or does not answer correctly: this affects all drawings.
    Server(Reason),
    /// A problem with this drawing.
    Job(JobError),
}

impl From<JobError> for SessionError {
    fn from(error: JobError) -> Self {
        Self::Job(error)
    }
}

/// A session with BeamServer.
pub(super) struct Server<'a> {
    stream: TcpStream,
    /// The bytes received after the last answer.
    rest: Vec<u8>,
    address: String,
    /// How long an answer may take.
    patience: Duration,
    /// When the session ends.
    end: Instant,
    stop: &'a StopSignal,
}

impl<'a> Server<'a> {
    pub(super) fn connect(delivery: &DeliverySettings, stop: &'a StopSignal) -> Result<Self, SessionError> {
        let address = delivery.address.clone();
        let failed = |error: std::io::Error| {
            let what = format!("BeamServer at {address} cannot be reached: {error}.");
            let remedy = "Start BeamServer, close other programs that are connected to it, or correct `delivery.address`.";
            SessionError::Server(Reason::new("beamserver-unreachable", what, remedy))
        };
        let mut addresses = address.to_socket_addrs().map_err(failed)?;
        let first = addresses.next().ok_or_else(|| failed(ErrorKind::AddrNotAvailable.into()))?;
        let stream = TcpStream::connect_timeout(&first, CONNECT).map_err(failed)?;
        stream.set_read_timeout(Some(LOOK)).map_err(failed)?;
        stream.set_write_timeout(Some(LOOK)).map_err(failed)?;
        stream.set_nodelay(true).map_err(failed)?;
        let patience = delivery.answer;
        let end = Instant::now() + patience.saturating_mul(MAX_ANSWERS);
        Ok(Self { stream, rest: Vec::new(), address, patience, end, stop })
    }

    /// Sends a command and returns the answer, or the numbers of an `ERROR`.
    fn ask(&mut self, command: &str) -> Result<Result<Answer, [i64; 2]>, SessionError> {
        let answer = self.exchange(command).map_err(|error| {
            let why = match error.kind() {
                ErrorKind::TimedOut => {
                    let what = if self.rest.is_empty() { "nothing" } else { "no complete line" };
                    format!("{what} arrived within {} s", self.patience.as_secs_f64())
                }
                ErrorKind::Interrupted => "the station is stopping".into(),
                _ => error.to_string(),
            };
            let what = format!("BeamServer at {} did not answer `{command}`: {why}.", self.address);
            let remedy = "Wait if BeamServer is starting or busy: isomark tries again. \
                          Otherwise raise `delivery.answer_s`, and close other programs that are connected to it.";
            SessionError::Server(Reason::new("beamserver-silent", what, remedy))
        })?;
        // No element and no value looks like this; some other kinds of servers repeat what they receive.
        let is_odd = |letter: char| letter.is_control() && letter != '\t';
        if answer.contains(is_odd) || answer == command {
            return Err(garbage(&answer, command));
        }
        let (first, rest) = answer.split_once(' ').unwrap_or((&answer, ""));
        Ok(match first {
            "ERROR" => {
                let mut numbers = rest.split([' ', ',']).filter_map(|number| number.parse().ok());
                let Some(first) = numbers.next() else { return Err(garbage(&answer, command)) };
                Err([first, numbers.next().unwrap_or(-1)])
            }
            "OK" => Ok(Answer::Ok(rest.trim_start().to_owned())),
            _ => Ok(Answer::Value(answer)),
        })
    }

    /// Sends a line and receives one; one deadline limits both, even if single bytes arrive slowly.
    fn exchange(&mut self, command: &str) -> std::io::Result<String> {
        let deadline = (Instant::now() + self.patience).min(self.end);
        let line = format!("{command}\n").into_bytes();
        let mut sent = 0;
        while sent < line.len() {
            sent += self.until(deadline, |stream| stream.write(&line[sent..]))?;
        }
        loop {
            if let Some(end) = self.rest.iter().position(|byte| *byte == b'\n') {
                let answer: Vec<u8> = self.rest.drain(..=end).collect();
                // Operators may give their own elements any name; the names of ours are ASCII.
                return Ok(String::from_utf8_lossy(&answer).trim().to_owned());
            }
            if self.rest.len() >= MAX_ANSWER {
                return Err(std::io::Error::new(ErrorKind::InvalidData, "the answer is too long"));
            }
            let mut piece = [0; 1024];
            let read = self.until(deadline, |stream| stream.read(&mut piece))?;
            self.rest.extend(&piece[..read]);
        }
    }

    /// Reads or writes, and tries again until the deadline or until the station stops.
    fn until(
        &mut self,
        deadline: Instant,
        mut step: impl FnMut(&mut TcpStream) -> std::io::Result<usize>,
    ) -> std::io::Result<usize> {
        loop {
            let now = Instant::now();
            if self.stop.is_raised() {
                self.end = self.end.min(now + STOP_GRACE);
            }
            if now >= deadline.min(self.end) {
                let stops = self.stop.is_raised();
                return Err(if stops { ErrorKind::Interrupted } else { ErrorKind::TimedOut }.into());
            }
            match step(&mut self.stream) {
                Ok(0) => return Err(ErrorKind::UnexpectedEof.into()),
                // Systems report a time-out with different errors, and a signal may interrupt the call.
                Err(error)
                    if matches!(
                        error.kind(),
                        ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted
                    ) => {}
                done => return done,
            }
        }
    }

    /// Sends a command that must succeed; returns the value.
    fn command(&mut self, command: &str) -> Result<String, SessionError> {
        self.ask(command)?.map_err(|numbers| refused(command, numbers)).map(Answer::value)
    }

    /// Sends a command that must succeed and returns no value.
    fn order(&mut self, command: &str) -> Result<(), SessionError> {
        done(command, self.ask(command)?.map_err(|numbers| refused(command, numbers))?)
    }

    /// Imports a file; returns the id of its element, the only new one with this name.
    pub(super) fn import_new(
        &mut self,
        name: &str,
        path: &str,
        before: &[String],
    ) -> Result<String, SessionError> {
        self.order(&format!("CmdImport {path}"))?;
        let mut new = self.elements(name)?;
        new.retain(|id| !before.contains(id));
        match <[String; 1]>::try_from(new) {
            Ok([new]) => Ok(new),
            // Another attempt would only create more copies.
            Err(new) => {
                let count = new.len();
                let what = format!(
                    "BeamConstruct has {count} new elements named {name} after the import, instead of one."
                );
                let remedy = "Delete the imported elements in BeamConstruct. Its version may name imported elements \
                              differently: report it.";
                Err(SessionError::Job(JobError::Rejected(Reason::new("beamserver-lost", what, remedy))))
            }
        }
    }

    /// Compares the size of the only element with this name with the size of the drawing, mm.
    pub(super) fn verify(
        &mut self,
        element: &str,
        drawing: &str,
        size: [f64; 2],
    ) -> Result<(), SessionError> {
        self.order(&format!("CmdSelEntName \\{element}"))?;
        for (axis, expected) in ["X", "Y"].into_iter().zip(size) {
            let found = self.number(&format!("CmdGetSize{axis}"))? / PER_MILLIMETRE;
            if !((found - expected).abs() <= SIZE_TOLERANCE) {
                return Err(SessionError::Job(JobError::Rejected(wrong_size(
                    drawing, axis, found, expected,
                ))));
            }
        }
        Ok(())
    }

    /// Removes an element, unless somebody has removed it already.
    pub(super) fn delete(&mut self, id: &str) -> Result<(), SessionError> {
        let command = format!("CmdDeleteEnt {id}");
        match self.ask(&command)? {
            Ok(answer) => done(&command, answer),
            Err([NO_SUCH_ELEMENT, _]) => Ok(()),
            Err(numbers) => Err(refused(&command, numbers)),
        }
    }

    /// Removes an element that was not verified and so must not be marked; returns why it was not verified.
    pub(super) fn take_back(&mut self, id: &str, error: SessionError) -> SessionError {
        // The session may be at its end, and the station may be stopping.
        self.end = Instant::now() + STOP_GRACE;
        match (error, self.delete(id)) {
            // The reason states that the element was removed, so the drop is rejected only then.
            (SessionError::Job(JobError::Rejected(_)), Err(trouble)) => trouble,
            (error, _) => error,
        }
    }

    fn number(&mut self, command: &str) -> Result<f64, SessionError> {
        let answer = self.command(command)?;
        // A size cannot be negative.
        let size = answer.parse().ok().filter(|size: &f64| size.is_finite() && *size >= 0.0);
        size.ok_or_else(|| garbage(&answer, command))
    }

    /// The ids of the elements with this name, with or without the separator that BeamConstruct puts before it.
    pub(super) fn elements(&mut self, name: &str) -> Result<Vec<String>, SessionError> {
        let mut ids = Vec::new();
        for index in 0..MAX_ELEMENTS {
            let element = match self.ask(&format!("CmdListName {index}"))? {
                Ok(element) => element.value(),
                // The number that ends the list is not documented for all versions; an empty project ends at once.
                Err([NO_SUCH_ELEMENT | BAD_INPUT, _]) => return Ok(ids),
                Err(numbers) => return Err(refused("CmdListName", numbers)),
            };
            if element.trim_start_matches(['\\', '/']) == name {
                let command = format!("CmdListUID {index}");
                let id = self.command(&command)?;
                // The id is sent back unchanged, so it must be one word.
                if id.is_empty() || id.contains(char::is_whitespace) || ids.contains(&id) {
                    return Err(garbage(&id, &command));
                }
                ids.push(id);
            }
        }
        let what = format!("BeamServer at {} lists more than {MAX_ELEMENTS} elements.", self.address);
        Err(SessionError::Server(Reason::new("beamserver-answer", what, CHECK_THE_SERVER)))
    }
}

/// The answer of BeamServer to a command that succeeded.
enum Answer {
    /// `OK`, and the text after it.
    Ok(String),
    /// Any other text.
    Value(String),
}

impl Answer {
    /// The requested value: some versions send `OK` before it.
    fn value(self) -> String {
        match self {
            Self::Ok(value) | Self::Value(value) => value,
        }
    }
}

/// Checks the answer to a command without a value: anything except `OK` means that it was not understood.
fn done(command: &str, answer: Answer) -> Result<(), SessionError> {
    match answer {
        Answer::Ok(_) => Ok(()),
        Answer::Value(answer) => Err(garbage(&answer, command)),
    }
}

/// The error for an invalid answer: the server is broken or is not BeamServer. The drawing is not the cause.
fn garbage(answer: &str, command: &str) -> SessionError {
    let shown: String = answer.chars().take(60).flat_map(char::escape_debug).collect();
    let what = format!("BeamServer answered `{shown}` to `{command}`, which is not a valid answer.");
    SessionError::Server(Reason::new("beamserver-answer", what, CHECK_THE_SERVER))
}

fn refused(command: &str, numbers: [i64; 2]) -> SessionError {
    let [first, second] = numbers;
    let what = format!("BeamServer refused `{command}`: ERROR {first} {second}.");
    let remedy = if UNREADABLE_FILE.contains(&first) {
        "Give BeamServer read access to the import folder, or correct `delivery.server_folder`, its path to that folder."
    } else {
        "Check BeamConstruct; isomark tries the delivery again."
    };
    SessionError::Job(JobError::Retry(Reason::new("beamserver-refused", what, remedy)))
}

fn wrong_size(name: &str, axis: &str, found: f64, expected: f64) -> Reason {
    let what = format!(
        "BeamConstruct imported {name} with a size of {found:.4} mm in {axis} instead of {expected:.4} mm; isomark removed it there."
    );
    let remedy = "Check BeamConstruct's import settings: unit mm, no scaling, no fitting to the field. Then drop the file again.";
    Reason::new("beamserver-size", what, remedy).with_number(
        &format!("size in {axis}"),
        found,
        "mm",
        Some(expected),
    )
}
