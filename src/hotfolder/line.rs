//! Jobs for other lines, as the hot folder hands them over and takes them.

use std::path::Path;
use std::sync::Arc;
use std::time::{SystemTime, UNIX_EPOCH};

use super::seen::names::{Meaning, is_ignored, meaning};
use crate::files::is_plain;
use crate::reason::Reason;

/// The code of the reason why a job of the fleet is not done here: another station has it, and may have marked it.
pub(crate) const TAKEN_OVER: &str = "job-taken-over";

/// A drawing with what belongs to it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Inputs {
    /// The drawing.
    pub drawing: Vec<u8>,
    /// The settings beside it.
    pub settings: Option<Vec<u8>>,
    /// The list of products beside it.
    pub list: Option<Vec<u8>>,
}

impl Inputs {
    /// The largest size of all together, bytes.
    pub const LARGEST: usize = 64 << 20;

    /// The size of all together, bytes.
    #[must_use]
    pub fn bytes(&self) -> usize {
        self.parts().into_iter().flatten().map(Vec::len).sum()
    }

    /// The hash of all together, as hexadecimal digits.
    #[must_use]
    pub fn hash(&self) -> String {
        let mut hasher = blake3::Hasher::new();
        for part in self.parts() {
            // What is absent differs from what is empty.
            hasher.update(&part.map_or(u64::MAX, |part| part.len() as u64).to_le_bytes());
            hasher.update(part.map_or(&[], Vec::as_slice));
        }
        hasher.finalize().to_hex().to_string()
    }

    fn parts(&self) -> [Option<&Vec<u8>>; 3] {
        [Some(&self.drawing), self.settings.as_ref(), self.list.as_ref()]
    }

    /// Why they are too large for a job; `None` if they are not.
    #[must_use]
    pub fn too_large(&self) -> Option<Reason> {
        Self::limit(self.bytes() as u64)
    }

    /// Why inputs of this size, bytes, are too large for a job; `None` if they are not.
    #[must_use]
    pub fn limit(bytes: u64) -> Option<Reason> {
        (bytes > Self::LARGEST as u64).then(|| {
            let what = "The drawing is too large for another line.";
            let remedy = "Simplify it, or drop it at its line.";
            let limit = Some(Self::LARGEST as f64);
            Reason::new("job-too-large", what, remedy).with_number("size", bytes as f64, "bytes", limit)
        })
    }
}

/// A drop, as the identity of a job needs it.
#[derive(Debug, Clone, Copy)]
pub struct Origin<'a> {
    /// The station, or the login of a person.
    pub sender: &'a str,
    /// The path of the drop.
    pub drop: &'a str,
    /// When it was written, or sent again.
    pub at: Option<SystemTime>,
}

/// A job for another line.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LineJob {
    /// The hash of the line, of the drop and of its inputs, as hexadecimal digits: the same drop is the same job.
    pub id: String,
    /// The line: a station or a group.
    pub line: String,
    /// The name of the drawing in the hot folder of that line.
    pub name: String,
    /// What is sent.
    pub inputs: Inputs,
}

impl LineJob {
    /// The job of a drop for a line.
    #[must_use]
    pub fn new(line: &str, name: &str, origin: Origin<'_>, inputs: Inputs) -> Self {
        let at = origin.at.and_then(|at| at.duration_since(UNIX_EPOCH).ok()).unwrap_or_default();
        let mut hasher = blake3::Hasher::new();
        for part in [line, name, origin.sender, origin.drop, &at.as_nanos().to_string(), &inputs.hash()] {
            hasher.update(&(part.len() as u64).to_le_bytes()).update(part.as_bytes());
        }
        let id = hasher.finalize().to_hex().to_string();
        Self { id, line: line.into(), name: name.into(), inputs }
    }
}

/// Checks the name of a drawing that is to be, or was, sent to another line.
///
/// # Errors
/// With the reason, when it is not the plain name of a drawing.
pub fn check_name(name: &str) -> Result<(), Reason> {
    let is_drawing = || matches!(meaning(Path::new(name)), Ok(Meaning::Pattern { .. }));
    if is_plain(name) && !is_ignored(name) && is_drawing() {
        return Ok(());
    }
    let reason = match meaning(Path::new(name)) {
        Err(reason) => reason,
        Ok(_) => Reason::new(
            "job-name",
            "Only drawings are sent to other lines, with a name such as can@date.dxf.",
            "Give the drawing, .dxf, .svg, .png or .bmp. Its settings and its list are sent with it; parts are known at all stations.",
        ),
    };
    Err(reason.in_file(name))
}

/// What became of an offer.
#[derive(Debug, Clone, PartialEq)]
pub enum Offered {
    /// The job is in the queue of the line, or was.
    Kept {
        /// Whether the queue has these inputs, and not earlier ones of the same drop.
        is_same: bool,
        /// Whether any station takes jobs of this line.
        is_served: bool,
    },
    /// The fleet never takes it.
    Refused(Reason),
    /// It waits.
    NotNow(Reason),
}

/// A job that another station or a person sent.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Arriving {
    /// Its identity.
    pub id: String,
    /// The number of this attempt.
    pub attempt: i32,
    /// The name of the drawing.
    pub name: String,
    /// Who sent it.
    pub sender: String,
    /// What was sent.
    pub inputs: Inputs,
}

/// The answer of the station to an [`Arriving`].
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Answer {
    /// It is in the journal, and its files are flushed under hidden names.
    Kept,
    /// It cannot be taken now.
    NotNow,
}

/// A job of this station and the number of its attempt.
pub type Claim = (String, i32);

/// How a job of another sender ended here.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Ended {
    /// The job.
    pub claim: Claim,
    /// `delivered`, `uncertain`, `listed`, `removed` or `rejected`.
    pub outcome: &'static str,
    /// Why, if it was not delivered.
    pub reason: Option<String>,
}

impl Ended {
    /// Whether the drawing, or drawings of its rows, may be marked here.
    #[must_use]
    pub fn may_be_marked(&self) -> bool {
        !matches!(self.outcome, "rejected" | "removed")
    }
}

/// What the journal of the station has about jobs of others.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct OurJobs {
    /// Whether the station takes another one.
    pub has_room: bool,
    /// Jobs that have not ended, and whether they are in the hot folder.
    pub open: Vec<(Claim, bool)>,
    /// Jobs whose end is to be reported.
    pub ended: Vec<Ended>,
}

/// What the fleet has to say about jobs.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum JobNews {
    /// Another sender has a job; the station answers.
    Arrives(Box<Arriving>),
    /// The job is certainly this station's.
    IsOurs(Claim),
    /// The job is certainly not this station's, or not any more.
    IsNotOurs(Claim),
    /// The end of the job is reported.
    Reported(Claim),
    /// The fleet answers: drops for other lines can go.
    Available,
}

/// Wakes the station from another thread.
pub type Wake = Box<dyn Fn() + Send + Sync>;

/// Jobs for other lines.
pub trait Lines: Send + Sync {
    /// The name of this station in the fleet.
    fn own_name(&self) -> &str;

    /// Why no job can be offered now; `None` if one can.
    fn cannot_offer(&self) -> Option<Reason>;

    /// Puts a job into the queue of its line, once. Waits for the answer for a moment.
    fn offer(&self, job: &Arc<LineJob>) -> Offered;

    /// Calls `wake` whenever there is news.
    fn wake_with(&self, wake: Wake);

    /// Takes what the journal has, and gives the news.
    fn exchange(&self, ours: OurJobs) -> Vec<JobNews>;

    /// Answers to [`JobNews::Arrives`].
    fn answer(&self, claim: &Claim, answer: Answer);

    /// Whether the fleet has stated, short enough ago, that this open job is the station's: nobody can have taken it over.
    fn is_confirmed(&self, claim: &Claim) -> bool;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hostile_names_are_refused() {
        for name in [
            "../can.dxf",
            "..",
            "/can.dxf",
            "can/x.dxf",
            "C:can.dxf",
            "a\\can.dxf",
            "can.glb",
            "can.toml",
            ".can.dxf",
            "can.dxf.tmp",
            "con.dxf",
            "can\n.dxf",
            "",
        ] {
            assert!(check_name(name).is_err(), "{name}");
        }
        assert!(check_name("can@date 2.dxf").is_ok() && check_name("can.SVG").is_ok());
    }

    #[test]
    fn the_same_drop_is_the_same_job_and_another_one_is_not() {
        let inputs = |drawing: &str, settings: Option<&str>| Inputs {
            drawing: drawing.into(),
            settings: settings.map(Into::into),
            list: None,
        };
        // Windows stores times in units of 100 ns.
        let at = |ticks: u64| Some(UNIX_EPOCH + std::time::Duration::from_nanos(100 * ticks));
        let job = |line: &str, drop: &str, ticks, inputs| {
            LineJob::new(line, "can.dxf", Origin { sender: "a", drop, at: at(ticks) }, inputs).id
        };
        let one = job("b", "can.dxf", 1, inputs("x", None));
        assert_eq!(one, job("b", "can.dxf", 1, inputs("x", None)));
        for other in [
            job("c", "can.dxf", 1, inputs("x", None)),
            job("b", "can/can.dxf", 1, inputs("x", None)),
            job("b", "can.dxf", 2, inputs("x", None)),
            job("b", "can.dxf", 1, inputs("y", None)),
            job("b", "can.dxf", 1, inputs("x", Some(""))),
        ] {
            assert_ne!(one, other);
        }
    }
}
