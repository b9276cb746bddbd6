//! Decides when a file is complete: a pure state machine for each file. Time is an argument, and no file is opened
//! here.
//!
//! A file is read when its writer was seen to close it or to rename it into place. If nothing is known about its
//! writer, it is read when its size and time have not changed for the settle time. A writer that was seen to write, but
//! not to close the file, may be a copy that has stalled: the station waits as long as for the rest of an incomplete
//! file. A file in a format without an end mark must stay unchanged for longer than others if nothing is known about
//! its writer. Even after its writer closed it, it must stay unchanged for a short time, because the writer may open it
//! again.
//!
//! If the content ends too early, the file is read again after its next change. If it does not change within a limit,
//! the file is rejected.

use std::time::{Duration, SystemTime};

/// Time since the station started.
pub type Moment = Duration;

/// What the file system reports about a file without opening it; equal stamps are treated as equal content.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Stamp {
    /// Size in bytes.
    pub size: u64,
    /// Time of the last write, if the system reports it.
    pub modified: Option<SystemTime>,
    /// Which file it is: the inode on Unix, the creation time elsewhere.
    pub identity: u64,
}

/// The waiting times.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SettleTimes {
    /// How long a file must stay unchanged before it is read, if no writer was seen to close it.
    pub still: Duration,
    /// The same for a file whose format has no end mark: half of it looks complete.
    pub open_ended: Duration,
    /// How long an incomplete file must stay unchanged before it is rejected; and a file that its writer has open,
    /// before it is read.
    pub incomplete: Duration,
    /// How long an incomplete file must stay unchanged after its writer closed it: only a writer that opens it again
    /// can complete it.
    pub incomplete_after_close: Duration,
}

/// What to do with a file now.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// Wait until this moment, unless the file changes.
    Wait(Moment),
    /// Read it; then do the job, or report with [`Settle::found_incomplete`] that it is incomplete.
    Read,
    /// Reject it: it is still incomplete, and nothing more is expected.
    GiveUp(Gap),
}

/// What is known about a file's writer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Writer {
    /// Nothing.
    Unknown,
    /// It was seen to write, and still has the file open.
    Open,
    /// It closed the file.
    Closed,
    /// It renamed the file into place, so the file is complete.
    Renamed,
}

/// How the end of a complete file is recognized.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ending {
    /// By an end mark or a length.
    Marked,
    /// Not at all, but the file is short and written in one step.
    Short,
    /// Not at all.
    Unmarked,
}

/// What is missing from an incomplete file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Gap {
    /// The rest of its content.
    Content,
    /// A file that it names.
    Companion,
}

/// The state of one file.
#[derive(Debug, Clone)]
pub struct Settle {
    stamp: Stamp,
    ending: Ending,
    /// When the stamp was first seen.
    since: Moment,
    /// How long the file had been unchanged when it was first seen.
    head_start: Duration,
    /// What is known about its writer, at the last change or since.
    writer: Writer,
    gap: Option<Gap>,
}

impl Settle {
    /// A file that is seen for the first time; `still_for` is how long it is known to be unchanged.
    pub fn new(stamp: Stamp, writer: Writer, now: Moment, still_for: Duration) -> Self {
        Self { stamp, ending: Ending::Marked, since: now, head_start: still_for, writer, gap: None }
    }

    /// The same file with this kind of ending.
    pub fn ending(self, ending: Ending) -> Self {
        Self { ending, ..self }
    }

    /// The last seen stamp.
    pub fn stamp(&self) -> Stamp {
        self.stamp
    }

    /// Records that the file was seen again; `writer` is what its writer was seen to do before that.
    pub fn see(&mut self, stamp: Stamp, writer: Writer, now: Moment) {
        let is_still_open = self.writer == Writer::Open && stamp.identity == self.stamp.identity;
        let writer = if writer == Writer::Unknown && is_still_open { Writer::Open } else { writer };
        if stamp != self.stamp {
            *self = Self { ending: self.ending, ..Self::new(stamp, writer, now, Duration::ZERO) };
        } else if writer != Writer::Unknown {
            // Two writes within one tick of the file system's clock can leave the same stamp.
            self.writer = writer;
            self.gap = self.gap.filter(|_| writer == Writer::Open);
        }
    }

    /// Records that events were lost: the writer may have closed the file.
    pub fn events_were_lost(&mut self) {
        if self.writer == Writer::Open {
            self.writer = Writer::Unknown;
        }
    }

    /// Records that the content was read and is incomplete.
    pub fn found_incomplete(&mut self, gap: Gap) {
        self.gap = Some(gap);
    }

    /// Whether a file that belongs to it was missing.
    pub fn lacks_companion(&self) -> bool {
        self.gap == Some(Gap::Companion)
    }

    /// Records that a missing file may have arrived: read this file again.
    pub fn companion_came(&mut self) {
        if self.gap == Some(Gap::Companion) {
            self.gap = None;
        }
    }

    /// Records that a missing file is arriving: the waiting time starts again.
    pub fn wait_anew(&mut self, now: Moment) {
        self.since = now;
        self.head_start = Duration::ZERO;
    }

    /// When the file is to be handled, if it does not change before.
    pub fn due(&self, times: &SettleTimes) -> Moment {
        // A writer that closed the file may open it again within this time.
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

    /// Whether it has not settled since its last change, so that it is not read yet.
    pub fn is_settling(&self, now: Moment, times: &SettleTimes) -> bool {
        self.gap.is_none() && now < self.due(times)
    }

    /// What to do with the file now.
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

    /// The name, the events with their times (ms), and the verdicts at later times (ms).
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
                "a copy that stalls and continues",
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
                "written, and the event of closing was lost",
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
                "the buffer arrived",
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
    fn a_format_without_an_end_mark_settles_later() {
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
        assert_eq!(settle.verdict(at(70_000), &TIMES), Read, "it is complete");
        let short = Settle::new(stamp(1), Writer::Unknown, at(0), Duration::ZERO).ending(Ending::Short);
        assert_eq!(short.verdict(at(0), &TIMES), wait(3_000));
    }

    #[test]
    fn the_time_before_the_first_look_is_included() {
        let stamp = Stamp { size: 1, modified: None, identity: 1 };
        let mut settle = Settle::new(stamp, Writer::Unknown, Duration::ZERO, Duration::from_secs(3600));
        assert_eq!(settle.verdict(Duration::ZERO, &TIMES), Read);
        settle.found_incomplete(Gap::Content);
        assert_eq!(settle.verdict(Duration::ZERO, &TIMES), CUT);
    }
}
