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

use std::io::{BufRead, BufReader, ErrorKind, Read, Write};
use std::net::{TcpStream, ToSocketAddrs};
use std::path::Path;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use super::job::JobError;
use crate::config::DeliverySettings;
use crate::reason::Reason;

const CONNECT: Duration = Duration::from_secs(3);
/// How long somebody who waits for his turn goes on waiting for one and the same other.
const PATIENCE: Duration = Duration::from_secs(2);
/// How long nobody tries to talk to a server that did not answer.
const REST: Duration = Duration::from_secs(2);
/// Codes of the reasons that count for all drawings.
const UNREACHABLE: &str = "beamserver-unreachable";
const SILENT: &str = "beamserver-silent";
/// Elements that a project may hold; more are a server that counts for ever.
const MOST_ELEMENTS: usize = 100_000;
/// The longest answer, bytes.
const LONGEST_ANSWER: u64 = 4096;
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

/// Who talks to BeamServer when: it knows one client. A drawing that would have to wait for a server that does not
/// answer is told so at once, so that its thread can do something else.
#[derive(Default)]
pub(super) struct Turns {
    line: Mutex<Line>,
    free: Condvar,
}

#[derive(Default)]
struct Line {
    /// Since when somebody talks to it.
    busy_since: Option<Instant>,
    /// Why nobody could the last time, and until when nobody tries again.
    silent: Option<(Reason, Instant)>,
}

impl Turns {
    fn line(&self) -> MutexGuard<'_, Line> {
        self.line.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Talks to BeamServer when it is one's turn.
    ///
    /// # Errors
    /// To be tried again when the turn does not come soon; else what `talk` says.
    pub(super) fn talk<T>(&self, talk: impl FnOnce() -> Result<T, JobError>) -> Result<T, JobError> {
        let _turn = self.turn()?;
        let said = talk();
        let is_silence = |reason: &&Reason| [UNREACHABLE, SILENT].contains(&reason.code.as_str());
        let silence = match &said {
            Err(JobError::Retry(reason)) => Some(reason).filter(is_silence),
            _ => None,
        };
        self.line().silent = silence.map(|reason| (reason.clone(), Instant::now() + REST));
        said
    }

    fn turn(&self) -> Result<Turn<'_>, JobError> {
        let mut line = self.line();
        loop {
            let now = Instant::now();
            if let Some((reason, until)) = &line.silent
                && (line.busy_since.is_some() || now < *until)
            {
                return Err(JobError::Retry(reason.clone()));
            }
            let Some(since) = line.busy_since else { break };
            let left = PATIENCE.saturating_sub(now.duration_since(since));
            if left.is_zero() {
                let what = "BeamServer is at another drawing.";
                return Err(JobError::Retry(Reason::new(
                    "beamserver-busy",
                    what,
                    "Nothing: it is tried again.",
                )));
            }
            line = self.free.wait_timeout(line, left).unwrap_or_else(PoisonError::into_inner).0;
        }
        line.busy_since = Some(Instant::now());
        Ok(Turn(self))
    }
}

/// Somebody's turn, until it is dropped.
struct Turn<'a>(&'a Turns);

impl Drop for Turn<'_> {
    fn drop(&mut self) {
        self.0.line().busy_since = None;
        self.0.free.notify_one();
    }
}

/// A drawing in the import folder that BeamConstruct is to hold.
pub(super) struct Drawing<'a> {
    /// Its file's name, and that of its element.
    pub(super) name: &'a str,
    /// Its path as BeamServer knows it.
    pub(super) path: String,
    /// Width and height, mm, if they are known.
    pub(super) size: Option<[f64; 2]>,
    /// Name and path of the same for trial.
    pub(super) trial: (&'a str, String),
    /// It was imported before: it is done if it is still there.
    pub(super) is_known: bool,
}

/// A path that can be sent to BeamServer.
///
/// # Errors
/// Rejects what is not ASCII.
pub(super) fn sendable(path: &Path) -> Result<String, JobError> {
    let ascii = path.to_str().filter(|path| path.is_ascii() && !path.contains(['\r', '\n']));
    ascii.map(str::to_owned).ok_or_else(|| {
        let what = format!("BeamServer takes ASCII paths only, and {} is none.", path.display());
        let remedy = "Name SKU, drawing and folder in plain letters.";
        JobError::Rejected(Reason::new("beamserver-path", what, remedy))
    })
}

/// Imports the drawing under its name; returns what was done, as words for the log. `lay_out` puts the file for trial
/// where its path says.
pub(super) fn import(
    delivery: &DeliverySettings,
    drawing: &Drawing<'_>,
    lay_out: impl FnOnce() -> Result<(), JobError>,
) -> Result<String, JobError> {
    let mut server = Server::connect(delivery)?;
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
        let verified = server.verify(trial, name, size);
        server.delete(&tried)?;
        verified?;
    }
    let new = server.import_new(name, &drawing.path, &before)?;
    before.iter().try_for_each(|old| server.delete(old))?;
    let mut story = "imported into BeamConstruct".to_owned();
    if !before.is_empty() {
        story += ", in place of the older one";
    }
    if let Some(size) = drawing.size {
        if let Err(error) = server.verify(name, name, size) {
            if matches!(error, JobError::Rejected(_)) {
                server.delete(&new)?;
            }
            return Err(error);
        }
        story += &format!(", {:.3} x {:.3} mm as it should be", size[0], size[1]);
    }
    Ok(story)
}

struct Server {
    stream: BufReader<TcpStream>,
    address: String,
    /// How long an answer may take.
    patience: Duration,
}

impl Server {
    fn connect(delivery: &DeliverySettings) -> Result<Self, JobError> {
        let address = delivery.address.clone();
        let failed = |error: std::io::Error| {
            let what = format!("BeamServer at {address} cannot be reached: {error}.");
            let remedy =
                "Start BeamServer, end other programs that talk to it, or correct `delivery.address`.";
            JobError::Retry(Reason::new(UNREACHABLE, what, remedy))
        };
        let mut addresses = address.to_socket_addrs().map_err(failed)?;
        let first = addresses.next().ok_or_else(|| failed(ErrorKind::AddrNotAvailable.into()))?;
        let stream = TcpStream::connect_timeout(&first, CONNECT).map_err(failed)?;
        stream.set_read_timeout(Some(delivery.answer)).map_err(failed)?;
        stream.set_write_timeout(Some(delivery.answer)).map_err(failed)?;
        stream.set_nodelay(true).map_err(failed)?;
        Ok(Self { stream: BufReader::new(stream), address, patience: delivery.answer })
    }

    /// Sends a command and returns the answer, or the numbers of an `ERROR`.
    fn ask(&mut self, command: &str) -> Result<Result<String, [i64; 2]>, JobError> {
        let answer = self.exchange(command).map_err(|error| {
            let why = match error.kind() {
                // Systems call a time-out by different names, and some "resource temporarily unavailable".
                ErrorKind::WouldBlock | ErrorKind::TimedOut => {
                    format!("nothing came within {} s", self.patience.as_secs_f64())
                }
                _ => error.to_string(),
            };
            let what = format!("BeamServer at {} gave no answer to `{command}`: {why}.", self.address);
            let remedy = "Wait if BeamServer is restarted or busy: it is tried again. \
                          Else raise `delivery.answer_s`, and end other programs that talk to it.";
            JobError::Retry(Reason::new(SILENT, what, remedy))
        })?;
        let (first, rest) = answer.split_once(' ').unwrap_or((&answer, ""));
        Ok(match first {
            "ERROR" => {
                let mut numbers = rest.split([' ', ',']).filter_map(|number| number.parse().ok());
                Err([numbers.next().unwrap_or(-1), numbers.next().unwrap_or(-1)])
            }
            "OK" => Ok(rest.trim_start().to_owned()),
            _ => Ok(answer),
        })
    }

    fn exchange(&mut self, command: &str) -> std::io::Result<String> {
        self.stream.get_mut().write_all(format!("{command}\n").as_bytes())?;
        let mut answer = Vec::new();
        (&mut self.stream).take(LONGEST_ANSWER).read_until(b'\n', &mut answer)?;
        if !answer.ends_with(b"\n") {
            return Err(ErrorKind::UnexpectedEof.into());
        }
        // Operators name their own elements as they like; ours are ASCII.
        Ok(String::from_utf8_lossy(&answer).trim().to_owned())
    }

    /// Sends a command that has to succeed.
    fn command(&mut self, command: &str) -> Result<String, JobError> {
        self.ask(command)?.map_err(|numbers| refused(command, numbers))
    }

    /// Imports a file; returns the id of its element, the only one of this name that was not there before.
    fn import_new(&mut self, name: &str, path: &str, before: &[String]) -> Result<String, JobError> {
        self.command(&format!("CmdImport {path}"))?;
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
                Err(JobError::Rejected(Reason::new("beamserver-lost", what, remedy)))
            }
        }
    }

    /// Compares the size of the only element of this name with that of the drawing, mm.
    fn verify(&mut self, element: &str, drawing: &str, size: [f64; 2]) -> Result<(), JobError> {
        self.command(&format!("CmdSelEntName \\{element}"))?;
        for (axis, expected) in ["X", "Y"].into_iter().zip(size) {
            let found = self.number(&format!("CmdGetSize{axis}"))? / PER_MILLIMETRE;
            if !((found - expected).abs() <= SIZE_TOLERANCE) {
                return Err(JobError::Rejected(wrong_size(drawing, axis, found, expected)));
            }
        }
        Ok(())
    }

    /// Removes an element, unless somebody did before.
    fn delete(&mut self, id: &str) -> Result<(), JobError> {
        let command = format!("CmdDeleteEnt {id}");
        match self.ask(&command)? {
            Ok(_) | Err([NO_SUCH_ELEMENT, _]) => Ok(()),
            Err(numbers) => Err(refused(&command, numbers)),
        }
    }

    fn number(&mut self, command: &str) -> Result<f64, JobError> {
        let answer = self.command(command)?;
        answer.parse().map_err(|_| {
            let what = format!("BeamServer answered `{answer}` to `{command}`, which is no number.");
            let remedy = "Report it with the version of BeamConstruct: its commands may have changed.";
            JobError::Retry(Reason::new("beamserver-answer", what, remedy))
        })
    }

    /// The ids of the elements that bear the name, with the separator that BeamConstruct puts before it or without.
    fn elements(&mut self, name: &str) -> Result<Vec<String>, JobError> {
        let mut ids = Vec::new();
        for index in 0..MOST_ELEMENTS {
            let element = match self.ask(&format!("CmdListName {index}"))? {
                Ok(element) => element,
                // Which number ends the list is not documented for all versions; an empty project ends at once.
                Err([NO_SUCH_ELEMENT | BAD_INPUT, _]) => break,
                Err(numbers) => return Err(refused("CmdListName", numbers)),
            };
            if element.trim_start_matches(['\\', '/']) == name {
                ids.push(self.command(&format!("CmdListUID {index}"))?);
            }
        }
        Ok(ids)
    }
}

fn refused(command: &str, numbers: [i64; 2]) -> JobError {
    let [first, second] = numbers;
    let what = format!("BeamServer refused `{command}`: ERROR {first} {second}.");
    let remedy = if UNREADABLE_FILE.contains(&first) {
        "Let BeamServer read the import folder, or correct `delivery.server_folder`, its name for that folder."
    } else {
        "Look at BeamConstruct; the delivery is tried again."
    };
    JobError::Retry(Reason::new("beamserver-refused", what, remedy))
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
