//! The commands of BeamServer, one talk at a time.

use std::io::{ErrorKind, Read, Write};
use std::net::{TcpStream, ToSocketAddrs};
use std::time::{Duration, Instant};

use crate::config::DeliverySettings;
use crate::hotfolder::api::JobError;
use crate::hotfolder::seen::StopSignal;
use crate::reason::Reason;

const CONNECT: Duration = Duration::from_secs(3);
/// How often somebody who waits for an answer looks whether the station is to stop.
const LOOK: Duration = Duration::from_millis(50);
/// How long a talk may still take when the station is to stop: a server that is well is done by then.
const LAST_WORDS: Duration = Duration::from_secs(2);
/// How many answers' time a whole talk may take.
const MOST_ANSWERS: u32 = 60;
/// Elements that a project may hold; more are a server that counts for ever.
const MOST_ELEMENTS: usize = 100_000;
/// The longest answer, bytes.
const LONGEST_ANSWER: usize = 4096;
/// Sizes are told in 1/10000 mm.
const PER_MILLIMETRE: f64 = 10_000.0;
/// How far the size may be off, mm: the importer works in whole micrometres, at both ends of the drawing.
const SIZE_TOLERANCE: f64 = 0.01;
/// BeamServer's first number for an element that does not exist.
const NO_SUCH_ELEMENT: i64 = 7;
/// Its first number for an index that makes no sense.
const BAD_INPUT: i64 = 16;
/// Its first numbers for a file that cannot be opened or read.
const UNREADABLE_FILE: [i64; 2] = [19, 21];
const CHECK_THE_SERVER: &str = "Check that `delivery.address` is that of BeamServer, and start BeamServer again: it is tried again. \
                                If it answers like this for ever, report it with the version of BeamConstruct.";

/// Why a talk ended early.
pub(crate) enum TalkError {
    /// The server cannot be reached, or does not answer as one does: that holds for all drawings.
    Ill(Reason),
    /// Something about this drawing.
    Job(JobError),
}

impl From<JobError> for TalkError {
    fn from(error: JobError) -> Self {
        Self::Job(error)
    }
}

/// A talk with BeamServer.
pub(super) struct Server<'a> {
    stream: TcpStream,
    /// What came after the last answer.
    rest: Vec<u8>,
    address: String,
    /// How long an answer may take.
    patience: Duration,
    /// When the talk ends.
    end: Instant,
    stop: &'a StopSignal,
}

impl<'a> Server<'a> {
    pub(super) fn connect(delivery: &DeliverySettings, stop: &'a StopSignal) -> Result<Self, TalkError> {
        let address = delivery.address.clone();
        let failed = |error: std::io::Error| {
            let what = format!("BeamServer at {address} cannot be reached: {error}.");
            let remedy =
                "Start BeamServer, end other programs that talk to it, or correct `delivery.address`.";
            TalkError::Ill(Reason::new("beamserver-unreachable", what, remedy))
        };
        let mut addresses = address.to_socket_addrs().map_err(failed)?;
        let first = addresses.next().ok_or_else(|| failed(ErrorKind::AddrNotAvailable.into()))?;
        let stream = TcpStream::connect_timeout(&first, CONNECT).map_err(failed)?;
        stream.set_read_timeout(Some(LOOK)).map_err(failed)?;
        stream.set_write_timeout(Some(LOOK)).map_err(failed)?;
        stream.set_nodelay(true).map_err(failed)?;
        let patience = delivery.answer;
        let end = Instant::now() + patience.saturating_mul(MOST_ANSWERS);
        Ok(Self { stream, rest: Vec::new(), address, patience, end, stop })
    }

    /// Sends a command and returns the answer, or the numbers of an `ERROR`.
    fn ask(&mut self, command: &str) -> Result<Result<Answer, [i64; 2]>, TalkError> {
        let answer = self.exchange(command).map_err(|error| {
            let why = match error.kind() {
                ErrorKind::TimedOut => {
                    let what = if self.rest.is_empty() { "nothing" } else { "no whole line" };
                    format!("{what} came within {} s", self.patience.as_secs_f64())
                }
                ErrorKind::Interrupted => "the station is to stop".into(),
                _ => error.to_string(),
            };
            let what = format!("BeamServer at {} gave no answer to `{command}`: {why}.", self.address);
            let remedy = "Wait if BeamServer is restarted or busy: it is tried again. \
                          Else raise `delivery.answer_s`, and end other programs that talk to it.";
            TalkError::Ill(Reason::new("beamserver-silent", what, remedy))
        })?;
        // No element and no value looks like this; some servers of other kinds repeat what they hear.
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

    /// Sends a line and takes one, both before one and the same moment however slowly they come.
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
                // Operators name their own elements as they like; ours are ASCII.
                return Ok(String::from_utf8_lossy(&answer).trim().to_owned());
            }
            if self.rest.len() >= LONGEST_ANSWER {
                return Err(std::io::Error::new(ErrorKind::InvalidData, "it has no end"));
            }
            let mut piece = [0; 1024];
            let read = self.until(deadline, |stream| stream.read(&mut piece))?;
            self.rest.extend(&piece[..read]);
        }
    }

    /// Reads or writes something, again and again until the deadline or the end of the station.
    fn until(
        &mut self,
        deadline: Instant,
        mut step: impl FnMut(&mut TcpStream) -> std::io::Result<usize>,
    ) -> std::io::Result<usize> {
        loop {
            let now = Instant::now();
            if self.stop.is_raised() {
                self.end = self.end.min(now + LAST_WORDS);
            }
            if now >= deadline.min(self.end) {
                let stops = self.stop.is_raised();
                return Err(if stops { ErrorKind::Interrupted } else { ErrorKind::TimedOut }.into());
            }
            match step(&mut self.stream) {
                Ok(0) => return Err(ErrorKind::UnexpectedEof.into()),
                // Systems call a time-out by different names, and some are interrupted by signals.
                Err(error)
                    if matches!(
                        error.kind(),
                        ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted
                    ) => {}
                done => return done,
            }
        }
    }

    /// Sends a command that has to succeed; returns the value.
    fn command(&mut self, command: &str) -> Result<String, TalkError> {
        self.ask(command)?.map_err(|numbers| refused(command, numbers)).map(Answer::value)
    }

    /// Sends a command that has to be done.
    fn order(&mut self, command: &str) -> Result<(), TalkError> {
        done(command, self.ask(command)?.map_err(|numbers| refused(command, numbers))?)
    }

    /// Imports a file; returns the id of its element, the only one of this name that was not there before.
    pub(super) fn import_new(
        &mut self,
        name: &str,
        path: &str,
        before: &[String],
    ) -> Result<String, TalkError> {
        self.order(&format!("CmdImport {path}"))?;
        let mut new = self.elements(name)?;
        new.retain(|id| !before.contains(id));
        match <[String; 1]>::try_from(new) {
            Ok([new]) => Ok(new),
            // Tried again, it would only pile up copies.
            Err(new) => {
                let count = new.len();
                let what = format!("BeamConstruct holds {count} new elements named {name} after the import.");
                let remedy = "Remove there what was imported. Its version may name imported elements differently; \
                              report it.";
                Err(TalkError::Job(JobError::Rejected(Reason::new("beamserver-lost", what, remedy))))
            }
        }
    }

    /// Compares the size of the only element of this name with that of the drawing, mm.
    pub(super) fn verify(&mut self, element: &str, drawing: &str, size: [f64; 2]) -> Result<(), TalkError> {
        self.order(&format!("CmdSelEntName \\{element}"))?;
        for (axis, expected) in ["X", "Y"].into_iter().zip(size) {
            let found = self.number(&format!("CmdGetSize{axis}"))? / PER_MILLIMETRE;
            if !((found - expected).abs() <= SIZE_TOLERANCE) {
                return Err(TalkError::Job(JobError::Rejected(wrong_size(drawing, axis, found, expected))));
            }
        }
        Ok(())
    }

    /// Removes an element, unless somebody did before.
    pub(super) fn delete(&mut self, id: &str) -> Result<(), TalkError> {
        let command = format!("CmdDeleteEnt {id}");
        match self.ask(&command)? {
            Ok(answer) => done(&command, answer),
            Err([NO_SUCH_ELEMENT, _]) => Ok(()),
            Err(numbers) => Err(refused(&command, numbers)),
        }
    }

    /// Removes an element that was not verified, as nobody is to mark it; returns why it was not.
    pub(super) fn take_back(&mut self, id: &str, error: TalkError) -> TalkError {
        // The talk may be at its end, and the station to stop.
        self.end = Instant::now() + LAST_WORDS;
        match (error, self.delete(id)) {
            // The drop is rejected when the element is gone, as the reason states.
            (TalkError::Job(JobError::Rejected(_)), Err(trouble)) => trouble,
            (error, _) => error,
        }
    }

    fn number(&mut self, command: &str) -> Result<f64, TalkError> {
        let answer = self.command(command)?;
        // No drawing is smaller than nothing.
        let size = answer.parse().ok().filter(|size: &f64| size.is_finite() && *size >= 0.0);
        size.ok_or_else(|| garbage(&answer, command))
    }

    /// The ids of the elements that bear the name, with the separator that BeamConstruct puts before it or without.
    pub(super) fn elements(&mut self, name: &str) -> Result<Vec<String>, TalkError> {
        let mut ids = Vec::new();
        for index in 0..MOST_ELEMENTS {
            let element = match self.ask(&format!("CmdListName {index}"))? {
                Ok(element) => element.value(),
                // Which number ends the list is not documented for all versions; an empty project ends at once.
                Err([NO_SUCH_ELEMENT | BAD_INPUT, _]) => return Ok(ids),
                Err(numbers) => return Err(refused("CmdListName", numbers)),
            };
            if element.trim_start_matches(['\\', '/']) == name {
                let command = format!("CmdListUID {index}");
                let id = self.command(&command)?;
                // It is sent back as it is.
                if id.is_empty() || id.contains(char::is_whitespace) || ids.contains(&id) {
                    return Err(garbage(&id, &command));
                }
                ids.push(id);
            }
        }
        let what = format!("BeamServer at {} lists more than {MOST_ELEMENTS} elements.", self.address);
        Err(TalkError::Ill(Reason::new("beamserver-answer", what, CHECK_THE_SERVER)))
    }
}

/// What BeamServer answers to a command that it did.
enum Answer {
    /// `OK`, and what follows it.
    Ok(String),
    /// Something else.
    Value(String),
}

impl Answer {
    /// The value that was asked for: some versions say `OK` before it.
    fn value(self) -> String {
        match self {
            Self::Ok(value) | Self::Value(value) => value,
        }
    }
}

/// A command that asks for nothing is answered by `OK`, or was not understood.
fn done(command: &str, answer: Answer) -> Result<(), TalkError> {
    match answer {
        Answer::Ok(_) => Ok(()),
        Answer::Value(answer) => Err(garbage(&answer, command)),
    }
}

/// The server is ill, or none: the drawing is not to blame.
fn garbage(answer: &str, command: &str) -> TalkError {
    let shown: String = answer.chars().take(60).flat_map(char::escape_debug).collect();
    let what = format!("BeamServer answered `{shown}` to `{command}`, which is no answer to that.");
    TalkError::Ill(Reason::new("beamserver-answer", what, CHECK_THE_SERVER))
}

fn refused(command: &str, numbers: [i64; 2]) -> TalkError {
    let [first, second] = numbers;
    let what = format!("BeamServer refused `{command}`: ERROR {first} {second}.");
    let remedy = if UNREADABLE_FILE.contains(&first) {
        "Let BeamServer read the import folder, or correct `delivery.server_folder`, its name for that folder."
    } else {
        "Look at BeamConstruct; the delivery is tried again."
    };
    TalkError::Job(JobError::Retry(Reason::new("beamserver-refused", what, remedy)))
}

fn wrong_size(name: &str, axis: &str, found: f64, expected: f64) -> Reason {
    let what = format!(
        "BeamConstruct shows {name} {found:.4} mm large in {axis}, and it is {expected:.4} mm; it was removed there."
    );
    let remedy = "Check BeamConstruct's import settings: unit mm, no scaling, no fitting to the field; then drop it again.";
    Reason::new("beamserver-size", what, remedy).with_number(
        &format!("size in {axis}"),
        found,
        "mm",
        Some(expected),
    )
}
