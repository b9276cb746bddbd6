//! The line on a terminal that shows the current step while a person waits.
//!
//! It is shown on standard error if that is a terminal, after one second of work, and is drawn again in its place. All
//! other output clears it first, so nothing is written behind it.

use std::io::{IsTerminal, Write};
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use crate::pipeline::Progress;
use crate::printable::on_one_line;

/// Work that is done sooner shows no line.
const PATIENCE: Duration = Duration::from_secs(1);
/// Time between two drawings of the line.
const INTERVAL: Duration = Duration::from_millis(200);
/// Columns of a terminal that does not state its width.
const COLUMNS: usize = 80;

static LINE: Mutex<Line> = Mutex::new(Line { jobs: Vec::new(), drawn: String::new(), columns_drawn: 0 });

fn line() -> MutexGuard<'static, Line> {
    LINE.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Shows the current step until it is dropped.
pub(super) struct ProgressLine(Option<(Sender<()>, JoinHandle<()>)>);

impl ProgressLine {
    /// Starts to show it, if standard error is a terminal.
    pub(super) fn start() -> Self {
        if !std::io::stderr().is_terminal() {
            return Self(None);
        }
        let (ends, ended) = channel();
        let started = Instant::now();
        let draw = move || {
            while ended.recv_timeout(INTERVAL) == Err(RecvTimeoutError::Timeout) {
                let passed = started.elapsed();
                if passed >= PATIENCE {
                    line().draw(passed, columns(), &mut std::io::stderr());
                }
            }
        };
        let thread = std::thread::Builder::new().spawn(draw);
        Self(thread.ok().map(|thread| (ends, thread)))
    }

    /// Receives the steps of a pipeline.
    pub(super) fn observer(&self) -> impl Fn(Progress<'_>) + Send + Sync + 'static {
        let is_shown = self.0.is_some();
        move |progress| {
            if is_shown {
                line().hear(&progress);
            }
        }
    }
}

impl Drop for ProgressLine {
    fn drop(&mut self) {
        if let Some((ends, thread)) = self.0.take() {
            drop(ends);
            let _ = thread.join();
            let mut line = line();
            line.jobs.clear();
            line.clear(&mut std::io::stderr());
        }
    }
}

/// Writes other output, with the line cleared before it.
pub(super) fn in_place_of_line<T>(write: impl FnOnce() -> T) -> T {
    let mut line = line();
    line.clear(&mut std::io::stderr());
    write()
}

/// Standard error, with the line cleared before each write.
pub(super) struct StandardError;

impl Write for StandardError {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        in_place_of_line(|| std::io::stderr().write(bytes))
    }

    fn flush(&mut self) -> std::io::Result<()> {
        std::io::stderr().flush()
    }
}

fn columns() -> usize {
    let size = terminal_size::terminal_size_of(std::io::stderr());
    size.map_or(COLUMNS, |(terminal_size::Width(columns), _)| columns.into())
}

/// The state of the line.
struct Line {
    /// The files that are worked on, each with its step; the one that began first is shown.
    jobs: Vec<(String, String)>,
    /// The text on the terminal now, and the columns it takes.
    drawn: String,
    columns_drawn: usize,
}

impl Line {
    fn hear(&mut self, progress: &Progress<'_>) {
        match progress {
            Progress::At { file, .. } => {
                let step = on_one_line(&progress.to_string());
                match self.jobs.iter_mut().find(|(known, _)| known == file) {
                    Some((_, known)) => *known = step,
                    None => self.jobs.push(((*file).to_owned(), step)),
                }
            }
            Progress::Done { file } => self.jobs.retain(|(known, _)| known != file),
        }
    }

    /// Draws the line over itself. Blanks clear what was longer before: consoles that know no codes take them, too.
    fn draw(&mut self, passed: Duration, columns: usize, out: &mut impl Write) {
        let Some((_, step)) = self.jobs.first() else { return self.clear(out) };
        let others = match self.jobs.len() - 1 {
            0 => String::new(),
            others => format!(" and {others} more"),
        };
        // The last column stays free, because writing into it may begin a new line.
        let text = format!("isomark: {step}{others}, {} s", passed.as_secs());
        let (text, drawn) = cut(&text, columns.saturating_sub(1));
        if self.columns_drawn > 0 && self.drawn == text {
            return;
        }
        let blanks = " ".repeat(self.columns_drawn.saturating_sub(drawn));
        (self.drawn, self.columns_drawn) = (text.to_owned(), drawn);
        let _ = write!(out, "\r{text}{blanks}").and_then(|()| out.flush());
    }

    fn clear(&mut self, out: &mut impl Write) {
        if self.columns_drawn > 0 {
            let _ = write!(out, "\r{}\r", " ".repeat(self.columns_drawn)).and_then(|()| out.flush());
            self.columns_drawn = 0;
        }
    }
}

/// As much of the text as has room, and the columns that it takes. A letter beyond ASCII is taken to be two columns wide.
fn cut(text: &str, columns: usize) -> (&str, usize) {
    let (mut end, mut taken) = (0, 0);
    for letter in text.chars() {
        let width = if letter.is_ascii() { 1 } else { 2 };
        if taken + width > columns {
            break;
        }
        (end, taken) = (end + letter.len_utf8(), taken + width);
    }
    (&text[..end], taken)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pipeline::Step;

    #[test]
    fn the_line_is_drawn_over_itself_and_cleared() {
        let mut line = Line { jobs: Vec::new(), drawn: String::new(), columns_drawn: 0 };
        let drawn = |line: &mut Line, seconds: u64, columns: usize| {
            let mut out = Vec::new();
            line.draw(Duration::from_secs(seconds), columns, &mut out);
            String::from_utf8(out).unwrap()
        };
        assert_eq!(drawn(&mut line, 1, 80), "", "nothing is done");
        line.hear(&Progress::At { file: "m\u{1b}.ply", step: Step::Read });
        assert_eq!(drawn(&mut line, 1, 80), "\risomark: reading m\\u{1b}.ply, 1 s");
        assert_eq!(drawn(&mut line, 1, 80), "", "it is there");
        line.hear(&Progress::At { file: "m\u{1b}.ply", step: Step::Fit });
        line.hear(&Progress::At { file: "b.dxf", step: Step::Method { number: 3, of: 7, name: "cone" } });
        assert_eq!(drawn(&mut line, 12, 80), "\risomark: fitting a surface to m\\u{1b}.ply and 1 more, 12 s");
        line.hear(&Progress::Done { file: "m\u{1b}.ply" });
        let text = drawn(&mut line, 13, 80);
        assert_eq!(text.trim_end(), "\risomark: b.dxf: method 3 of 7, cone, 13 s");
        assert_eq!(text.len(), 1 + "isomark: fitting a surface to m\\u{1b}.ply and 1 more, 12 s".len());
        // A narrow terminal wraps nothing.
        assert_eq!(drawn(&mut line, 14, 12).trim_end(), "\risomark: b.");
        line.hear(&Progress::Done { file: "b.dxf" });
        assert_eq!(drawn(&mut line, 15, 80), format!("\r{}\r", " ".repeat(11)));
        assert_eq!(drawn(&mut line, 16, 80), "");
        assert_eq!(cut("a日本", 4), ("a日", 3));
    }
}
