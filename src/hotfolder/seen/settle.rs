//! When a file is whole: a pure state machine per file. Time is an argument, nothing is opened here.
//!
//! A file is read when its writer was seen to close it or to rename it into place; or, if nothing is known of its
//! writer, when its size and time stood still for the settle time. A writer that was seen to write and not yet to close
//! may be a copy that stalls, and is waited for as long as for the rest of a file; where nothing is known of its writer,
//! a file of a format without an end mark must stand still for longer than others, and for a moment even after its writer
//! closed it, who may open it again. If its content then turns out to end
//! too early, it is read again after its next change; if there is none within a limit, the job goes on and the file is
//! rejected.

use std::time::{Duration, SystemTime};

/// Time since the station started.
pub type Moment = Duration;

/// What the file system says about a file's content without opening it; equal stamps are taken for equal content.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Stamp {
    /// Size in bytes.
    pub size: u64,
    /// Time of the last write, where the system knows it.
    pub modified: Option<SystemTime>,
    /// Which file it is: the inode on Unix, the creation time elsewhere.
    pub identity: u64,
}

/// How long to wait for what.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SettleTimes {
    /// How long a file must stand still before it is read, if no writer was seen to close it.
    pub still: Duration,
    /// The same for a file whose format has no end mark: half of it looks whole.
    pub open_ended: Duration,
    /// How long an incomplete file must stand still before it is given up, and one that its writer has open before it
    /// is read.
    pub incomplete: Duration,
    /// The same after its writer closed it: only a writer that opens it again can still complete it.
    pub incomplete_after_close: Duration,
}

/// What is to be done about a file now.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// Nothing before this moment, unless something is seen or heard.
    Wait(Moment),
    /// Read it; then do the job, or tell with [`Settle::found_incomplete`] that it cannot be done yet.
    Read,
    /// It still lacks this and nothing more is to be expected: reject it.
    GiveUp(Gap),
}

/// What is known of a file's writer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Writer {
    /// Nothing.
    Unknown,
    /// It was seen to write; where closing is seen, too, it still has the file open.
    Open,
    /// It closed the file.
    Closed,
    /// It renamed the file into place, so the file is whole.
    Renamed,
}

/// How the end of a whole file is known.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ending {
    /// By an end mark or a length.
    Marked,
    /// By nothing, but the file is short and written in one go.
    Short,
    /// By nothing.
    Unmarked,
}

/// What an incomplete file lacks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Gap {
    /// Its own end.
    Content,
    /// A file that it names and that is still to come.
    Companion,
}

/// What is known of one file.
#[derive(Debug, Clone)]
pub struct Settle {
    stamp: Stamp,
    ending: Ending,
    /// When the stamp was first seen.
    since: Moment,
    /// How long the file had been standing still when it was first seen.
    head_start: Duration,
    /// What was seen of its writer, at the last change or since.
    writer: Writer,
    gap: Option<Gap>,
}

impl Settle {
    /// A file seen for the first time; `still_for` is how long it is known to have stood still already.
    pub fn new(stamp: Stamp, writer: Writer, now: Moment, still_for: Duration) -> Self {
        Self { stamp, ending: Ending::Marked, since: now, head_start: still_for, writer, gap: None }
    }

    /// The same for a file that ends like this.
    pub fn ending(self, ending: Ending) -> Self {
        Self { ending, ..self }
    }

    /// The stamp last seen.
    pub fn stamp(&self) -> Stamp {
        self.stamp
    }

    /// The file was seen again; `writer` is what its writer was seen to do before that.
    pub fn see(&mut self, stamp: Stamp, writer: Writer, now: Moment) {
        let goes_on = self.writer == Writer::Open && stamp.identity == self.stamp.identity;
        let writer = if writer == Writer::Unknown && goes_on { Writer::Open } else { writer };
        if stamp != self.stamp {
            *self = Self { ending: self.ending, ..Self::new(stamp, writer, now, Duration::ZERO) };
        } else if writer != Writer::Unknown {
            // Two writes within one tick of the file system's clock can leave the same stamp.
            self.writer = writer;
            self.gap = self.gap.filter(|_| writer == Writer::Open);
        }
    }

    /// What was not heard may have been that the writer closed the file.
    pub fn events_were_lost(&mut self) {
        if self.writer == Writer::Open {
            self.writer = Writer::Unknown;
        }
    }

    /// Its content was read and is incomplete.
    pub fn found_incomplete(&mut self, gap: Gap) {
        self.gap = Some(gap);
    }

    /// A file that it may lack has come: read it again.
    pub fn companion_came(&mut self) {
        if self.gap == Some(Gap::Companion) {
            self.gap = None;
        }
    }

    /// What it lacks is on its way: the limit counts from now.
    pub fn wait_anew(&mut self, now: Moment) {
        self.since = now;
        self.head_start = Duration::ZERO;
    }

    /// When something is to be done about the file, if it is not seen again before.
    pub fn due(&self, times: &SettleTimes) -> Moment {
        // A writer that closed the file may open it again as long as this.
        let again = times.incomplete_after_close.min(times.open_ended);
        let needed = match self.gap {
            None => match self.writer {
                Writer::Renamed => Duration::ZERO,
                Writer::Closed if self.ending == Ending::Unmarked => again,
                Writer::Closed => Duration::ZERO,
                Writer::Unknown => match self.ending {
                    Ending::Marked => times.still,
                    Ending::Short => again.max(times.still),
                    Ending::Unmarked => times.open_ended.max(times.still),
                },
                Writer::Open => times.incomplete.max(times.still),
            },
            Some(Gap::Content) if matches!(self.writer, Writer::Closed | Writer::Renamed) => {
                times.incomplete_after_close.min(times.incomplete)
            }
            Some(_) => times.incomplete,
        };
        self.since + needed.saturating_sub(self.head_start)
    }

    /// Whether it is to be read for the first time since it changed, and not yet.
    pub fn is_settling(&self, now: Moment, times: &SettleTimes) -> bool {
        self.gap.is_none() && now < self.due(times)
    }

    /// What is to be done now.
    pub fn verdict(&self, now: Moment, times: &SettleTimes) -> Verdict {
        let due = self.due(times);
        match self.gap {
            _ if now < due => Verdict::Wait(due),
            None => Verdict::Read,
            Some(gap) => Verdict::GiveUp(gap),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TIMES: SettleTimes = SettleTimes {
        still: Duration::from_millis(500),
        open_ended: Duration::from_millis(30_000),
        incomplete: Duration::from_millis(60_000),
        incomplete_after_close: Duration::from_millis(3_000),
    };

    #[derive(Clone, Copy)]
    enum Event {
        Seen(u64),
        Written(u64),
        Closed(u64),
        EventsLost,
        Incomplete(Gap),
        CompanionCame,
    }

    use Event::{Closed, CompanionCame, EventsLost, Incomplete, Seen, Written};
    use Verdict::Read;

    const CUT: Verdict = Verdict::GiveUp(Gap::Content);
    const ALONE: Verdict = Verdict::GiveUp(Gap::Companion);

    fn wait(milliseconds: u64) -> Verdict {
        Verdict::Wait(Duration::from_millis(milliseconds))
    }

    /// What happened when (ms), and the verdict at the moments after it.
    type Case = (&'static str, &'static [(u64, Event)], Vec<(u64, Verdict)>);

    #[test]
    fn files_settle() {
        let cases: Vec<Case> = vec![
            ("found by a listing", &[(0, Seen(9))], vec![(0, wait(500)), (499, wait(500)), (500, Read)]),
            ("renamed into place", &[(10, Closed(9))], vec![(10, Read)]),
            (
                "still growing",
                &[(0, Seen(1)), (400, Seen(2)), (800, Seen(3))],
                vec![(800, wait(1300)), (1300, Read)],
            ),
            ("grown, then closed", &[(0, Seen(1)), (100, Seen(2)), (900, Closed(3))], vec![(900, Read)]),
            (
                "closed, then written again",
                &[(0, Closed(1)), (5, Seen(2))],
                vec![(5, wait(505)), (505, Read)],
            ),
            ("seen again unchanged", &[(0, Closed(1)), (5, Seen(1))], vec![(5, Read)]),
            (
                "a copy that stalls",
                &[(0, Seen(1)), (500, Incomplete(Gap::Content))],
                vec![(500, wait(60_000)), (59_999, wait(60_000)), (60_000, CUT)],
            ),
            (
                "a copy that stalls and goes on",
                &[(0, Seen(1)), (500, Incomplete(Gap::Content)), (50_000, Seen(2))],
                vec![(50_000, wait(50_500)), (50_500, Read), (60_000, Read)],
            ),
            (
                "a copy that stalls, of a format without an end",
                &[(0, Written(1)), (9, Seen(1)), (400, Seen(2))],
                vec![(1000, wait(60_400)), (60_400, Read)],
            ),
            ("written, then closed", &[(0, Written(1)), (5, Closed(1))], vec![(5, Read)]),
            ("closed, then opened again", &[(0, Closed(1)), (5, Written(1))], vec![(5, wait(60_000))]),
            (
                "written, and nobody heard it closed",
                &[(0, Written(1)), (5, EventsLost)],
                vec![(5, wait(500)), (500, Read)],
            ),
            (
                "closed too early",
                &[(0, Closed(1)), (1, Incomplete(Gap::Content))],
                vec![(1, wait(3000)), (3000, CUT)],
            ),
            (
                "closed too early, completed by another writer",
                &[(0, Closed(1)), (1, Incomplete(Gap::Content)), (200, Closed(2))],
                vec![(200, Read)],
            ),
            (
                "waits for its buffer",
                &[(0, Closed(1)), (1, Incomplete(Gap::Companion))],
                vec![(3000, wait(60_000)), (60_000, ALONE)],
            ),
            (
                "the buffer came",
                &[(0, Closed(1)), (1, Incomplete(Gap::Companion)), (7000, CompanionCame)],
                vec![(7000, Read)],
            ),
            (
                "rewritten within a clock tick",
                &[(0, Closed(1)), (1, Incomplete(Gap::Content)), (2, Closed(1))],
                vec![(2, Read)],
            ),
        ];
        for (name, events, verdicts) in cases {
            let mut settle: Option<Settle> = None;
            for (at, event) in events {
                let now = Duration::from_millis(*at);
                let mut see = |size, writer| {
                    let stamp = Stamp { size, modified: None, identity: 1 };
                    match settle.as_mut() {
                        Some(settle) => settle.see(stamp, writer, now),
                        None => settle = Some(Settle::new(stamp, writer, now, Duration::ZERO)),
                    }
                };
                match event {
                    Seen(size) => see(*size, Writer::Unknown),
                    Written(size) => see(*size, Writer::Open),
                    Closed(size) => see(*size, Writer::Closed),
                    EventsLost => settle.as_mut().unwrap().events_were_lost(),
                    Incomplete(gap) => settle.as_mut().unwrap().found_incomplete(*gap),
                    CompanionCame => settle.as_mut().unwrap().companion_came(),
                }
            }
            for (at, expected) in verdicts {
                let verdict = settle.as_ref().unwrap().verdict(Duration::from_millis(at), &TIMES);
                assert_eq!(verdict, expected, "{name}, at {at} ms");
            }
        }
    }

    #[test]
    fn a_format_without_an_end_mark_stands_still_for_longer() {
        let stamp = |size| Stamp { size, modified: None, identity: 1 };
        let at = Duration::from_millis;
        let mut settle =
            Settle::new(stamp(1), Writer::Unknown, at(0), Duration::ZERO).ending(Ending::Unmarked);
        assert_eq!(settle.verdict(at(29_999), &TIMES), wait(30_000));
        settle.see(stamp(2), Writer::Unknown, at(29_999));
        assert_eq!(settle.verdict(at(30_000), &TIMES), wait(59_999));
        assert_eq!(settle.verdict(at(59_999), &TIMES), Read);
        settle.see(stamp(3), Writer::Closed, at(60_000));
        assert_eq!(settle.verdict(at(60_000), &TIMES), wait(63_000), "its writer may open it again");
        assert_eq!(settle.verdict(at(63_000), &TIMES), Read);
        settle.see(stamp(4), Writer::Renamed, at(70_000));
        assert_eq!(settle.verdict(at(70_000), &TIMES), Read, "it came whole");
        let short = Settle::new(stamp(1), Writer::Unknown, at(0), Duration::ZERO).ending(Ending::Short);
        assert_eq!(short.verdict(at(0), &TIMES), wait(3_000));
    }

    #[test]
    fn stillness_before_the_first_look_counts() {
        let stamp = Stamp { size: 1, modified: None, identity: 1 };
        let mut settle = Settle::new(stamp, Writer::Unknown, Duration::ZERO, Duration::from_secs(3600));
        assert_eq!(settle.verdict(Duration::ZERO, &TIMES), Read);
        settle.found_incomplete(Gap::Content);
        assert_eq!(settle.verdict(Duration::ZERO, &TIMES), CUT);
    }
}
