//! The steps of a pipeline, for a program that shows them to a waiting person.

use std::fmt;
use std::sync::Arc;

/// An event in the work of a pipeline.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Progress<'a> {
    /// A step begins.
    At {
        /// The part or drawing.
        file: &'a str,
        /// The step.
        step: Step<'a>,
    },
    /// The work on a file has ended, well or not.
    Done {
        /// The part or drawing.
        file: &'a str,
    },
}

/// A step that may take long.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Step<'a> {
    /// The file is read.
    Read,
    /// The surface of a part is sampled and fitted.
    Fit,
    /// The surface is kept in the cache.
    Keep,
    /// The drawing is placed, and its ink sampled.
    Place,
    /// The map from the drawing to the part is found.
    Map,
    /// The drawing is bent.
    Bend,
    /// The result is measured.
    Measure,
    /// The corrected drawing is written.
    Write,
    /// The picture is prepared.
    Preview,
    /// One of several methods is measured.
    Method {
        /// Its number, from 1.
        number: usize,
        /// How many there are.
        of: usize,
        /// Its name.
        name: &'a str,
    },
}

impl fmt::Display for Progress<'_> {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (file, step) = match self {
            Self::At { file, step } => (file, step),
            Self::Done { file } => return write!(out, "{file} is done"),
        };
        match step {
            Step::Read => write!(out, "reading {file}"),
            Step::Fit => write!(out, "fitting a surface to {file}"),
            Step::Keep => write!(out, "keeping the surface of {file}"),
            Step::Place => write!(out, "placing {file}"),
            Step::Map => write!(out, "finding the map for {file}"),
            Step::Bend => write!(out, "bending {file}"),
            Step::Measure => write!(out, "measuring {file}"),
            Step::Write => write!(out, "writing the corrected {file}"),
            Step::Preview => write!(out, "drawing the preview of {file}"),
            Step::Method { number, of, name } => write!(out, "{file}: method {number} of {of}, {name}"),
        }
    }
}

type Observe = dyn Fn(Progress<'_>) + Send + Sync;

/// Called at the beginning of each step, by the thread that does it.
#[derive(Clone, Default)]
pub(super) struct Observer(Option<Arc<Observe>>);

impl Observer {
    pub(super) fn new(observe: impl Fn(Progress<'_>) + Send + Sync + 'static) -> Self {
        Self(Some(Arc::new(observe)))
    }

    /// The steps of the work on a file, which end when the value is dropped.
    pub(super) fn steps<'a>(&'a self, file: &'a str) -> Steps<'a> {
        Steps { observer: self, file }
    }

    fn observe(&self, progress: Progress<'_>) {
        if let Some(observe) = &self.0 {
            observe(progress);
        }
    }
}

impl fmt::Debug for Observer {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.write_str(if self.0.is_some() { "Observer" } else { "no observer" })
    }
}

/// The work on a file.
pub(super) struct Steps<'a> {
    observer: &'a Observer,
    file: &'a str,
}

impl Steps<'_> {
    pub(super) fn at(&self, step: Step<'_>) {
        self.observer.observe(Progress::At { file: self.file, step });
    }
}

impl Drop for Steps<'_> {
    fn drop(&mut self) {
        self.observer.observe(Progress::Done { file: self.file });
    }
}
