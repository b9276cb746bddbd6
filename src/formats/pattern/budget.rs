//! The budget of a drawing: every step that creates something spends from it first.
//!
//! A few bytes in a file can create any amount of data: rows of blocks, a pattern of hairlines, splines of high degree.
//! The budget limits the memory and the time for the whole drawing.

use std::borrow::Cow;

use super::error::{EntityName, PatternReadError};
use crate::formats::Pace;

/// What is counted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Cost {
    /// Entities of the file, including those of its blocks.
    Listed,
    /// Entities after unfolding the blocks.
    Unfolded,
    /// Copies of blocks, including empty ones.
    Copies,
    /// Segments and dots in blocks and in the current entity.
    Held,
    /// Segments and dots of paths.
    Drawn,
    /// Steps of work, each about as long as comparing two numbers takes.
    Steps,
}

impl Cost {
    /// The largest number in one drawing.
    pub(super) const fn limit(self) -> usize {
        match self {
            Self::Listed => 2_000_000,
            // The whole job needs about a kilobyte for each of them.
            Self::Unfolded | Self::Copies | Self::Held | Self::Drawn => 1_000_000,
            Self::Steps => 200_000_000,
        }
    }

    /// The largest number at a quick pace, which includes the time for the rest of the job.
    const fn quick_limit(self) -> usize {
        match self {
            // Limited by the size of the file.
            Self::Listed => usize::MAX,
            Self::Unfolded | Self::Copies | Self::Held | Self::Drawn => 20_000,
            Self::Steps => 10_000_000,
        }
    }

    /// The error for a drawing that exceeds the limit, with the entity where this was found.
    pub(super) fn too_many(self, entity: EntityName) -> PatternReadError {
        let what = match self {
            Self::Listed | Self::Unfolded => "entities",
            Self::Copies => "copies of a block",
            Self::Held | Self::Drawn => "segments and dots",
            Self::Steps => "steps of work in hatches, splines and texts",
        };
        PatternReadError::TooMany { what, limit: self.limit(), entity: Some(entity) }
    }
}

/// Largest number of steps for one entity: a hatch of a million lines needs most of it.
const STEPS_OF_ENTITY: usize = Cost::Steps.limit() / 4;
/// Number of steps for creating a segment.
const STEPS_OF_SEGMENT: usize = 8;

/// What a drawing has spent so far.
#[derive(Debug, Default)]
pub(super) struct Budget {
    spent: [usize; 6],
    pace: Pace,
    takes_long: bool,
    /// Steps that were spent before the current entity.
    steps_before: usize,
    exceeded: Option<Cost>,
}

/// A limit of the entity or of the drawing is exceeded. [`Budget::exceeded`] shows which, so that callers can treat
/// both like an entity that cannot be read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Exceeded;

impl From<Exceeded> for String {
    fn from(Exceeded: Exceeded) -> Self {
        format!("drawing it takes more than {STEPS_OF_ENTITY} steps: simplify it in the drawing program")
    }
}

impl From<Exceeded> for Cow<'static, str> {
    fn from(exceeded: Exceeded) -> Self {
        String::from(exceeded).into()
    }
}

impl Budget {
    /// The budget of a drawing at this pace.
    pub(super) fn new(pace: Pace) -> Self {
        Self { pace, ..Self::default() }
    }

    /// Spends `count`, or nothing if that exceeds the limit.
    pub(super) fn spend(&mut self, cost: Cost, count: usize) -> Result<(), Exceeded> {
        self.check(cost, count)?;
        self.spent[cost as usize] += count;
        Ok(())
    }

    /// Checks whether `count` could be spent, without spending it.
    pub(super) fn check(&mut self, cost: Cost, count: usize) -> Result<(), Exceeded> {
        let spent = self.spent[cost as usize].saturating_add(count);
        let is_too_many = spent > cost.limit();
        if is_too_many || !self.pace.allows(spent, cost.quick_limit()) {
            self.takes_long |= !is_too_many;
            self.exceeded.get_or_insert(cost);
            return Err(Exceeded);
        }
        Ok(())
    }

    /// Whether the drawing was refused only because of the quick pace.
    pub(super) fn takes_long(&self) -> bool {
        self.takes_long
    }

    /// Spends steps of work on the current entity.
    pub(super) fn work(&mut self, steps: usize) -> Result<(), Exceeded> {
        let of_entity = (self.spent(Cost::Steps) - self.steps_before).saturating_add(steps);
        if of_entity > STEPS_OF_ENTITY {
            return Err(Exceeded);
        }
        self.spend(Cost::Steps, steps)
    }

    /// Spends segments or dots of the current entity.
    pub(super) fn hold(&mut self, pieces: usize) -> Result<(), Exceeded> {
        self.spend(Cost::Held, pieces)?;
        self.work(pieces * STEPS_OF_SEGMENT)
    }

    /// Begins the next entity: later work is counted for it.
    pub(super) fn begin_entity(&mut self) {
        self.steps_before = self.spent(Cost::Steps);
    }

    pub(super) fn spent(&self, cost: Cost) -> usize {
        self.spent[cost as usize]
    }

    /// Gives back the held segments and dots above the number `held`.
    pub(super) fn release(&mut self, held: usize) {
        self.spent[Cost::Held as usize] = held;
    }

    /// The limit of the drawing that was exceeded first.
    pub(super) fn exceeded(&self) -> Option<Cost> {
        self.exceeded
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_exceeded_limit_is_recorded_and_nothing_is_spent() {
        let mut budget = Budget::default();
        budget.hold(Cost::Held.limit()).unwrap();
        assert_eq!(
            (budget.spend(Cost::Held, usize::MAX), budget.exceeded()),
            (Err(Exceeded), Some(Cost::Held))
        );
        assert_eq!(budget.spent(Cost::Held), Cost::Held.limit());
        budget.release(5);
        assert!(budget.spend(Cost::Held, 1).is_ok() && budget.spent(Cost::Held) == 6);
    }

    #[test]
    fn a_quick_limit_is_distinguished_from_a_limit() {
        for (count, takes_long) in [(Cost::Drawn.quick_limit() + 1, true), (usize::MAX, false)] {
            let mut budget = Budget::new(Pace::Quick);
            assert_eq!(budget.check(Cost::Drawn, count), Err(Exceeded));
            assert_eq!((budget.takes_long(), budget.spent(Cost::Drawn)), (takes_long, 0));
        }
    }

    #[test]
    fn one_entity_gets_only_a_share_of_the_work() {
        let mut budget = Budget::default();
        for _ in 0..4 {
            budget.begin_entity();
            budget.work(STEPS_OF_ENTITY).unwrap();
            assert_eq!((budget.work(1), budget.exceeded()), (Err(Exceeded), None));
        }
        budget.begin_entity();
        assert_eq!((budget.work(1), budget.exceeded()), (Err(Exceeded), Some(Cost::Steps)));
    }
}
