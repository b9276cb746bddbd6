//! How much a drawing may come to: one budget, from which all that makes something takes before it is made.
//!
//! A few bytes can ask for anything: rows of blocks, a pattern of hairlines, splines of high degree. What is counted here
//! bounds the memory and the time of a drawing, wherever in the file it is asked for.

use std::borrow::Cow;

use super::super::error::{EntityName, PatternReadError};
use crate::formats::Pace;

/// What is counted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Cost {
    /// Entities of the file, those of its blocks too.
    Listed,
    /// Entities after unfolding.
    Unfolded,
    /// Copies of blocks, empty ones too.
    Copies,
    /// Segments and dots of what blocks hold and of the entity that is being read.
    Held,
    /// Segments and dots of paths.
    Drawn,
    /// Steps of work, each about as long as comparing two numbers takes.
    Steps,
}

impl Cost {
    /// The largest number of it in one drawing.
    pub(super) const fn limit(self) -> usize {
        match self {
            Self::Listed => 2_000_000,
            // The whole job takes about a kilobyte for each of them.
            Self::Unfolded | Self::Copies | Self::Held | Self::Drawn => 1_000_000,
            Self::Steps => 200_000_000,
        }
    }

    /// As many of it are a moment's work, together with all that follows for the whole drawing.
    const fn moment(self) -> usize {
        match self {
            // No more than the file has bytes for.
            Self::Listed => usize::MAX,
            Self::Unfolded | Self::Copies | Self::Held | Self::Drawn => 20_000,
            Self::Steps => 10_000_000,
        }
    }

    /// The refusal of a drawing that has more of it, and the entity where that showed.
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

/// Largest number of steps for one entity: a hatch of a million lines takes most of it.
const STEPS_OF_ENTITY: usize = Cost::Steps.limit() / 4;
/// Making a segment takes so many steps.
const STEPS_OF_SEGMENT: usize = 8;

/// What a drawing has spent so far.
#[derive(Debug, Default)]
pub(super) struct Budget {
    spent: [usize; 6],
    pace: Pace,
    takes_long: bool,
    /// Steps that were spent before the entity that is being read.
    steps_before: usize,
    exceeded: Option<Cost>,
}

/// There is too much of something. Where it is the drawing that has too much, [`Budget::exceeded`] knows, so nobody on the
/// way needs to tell that apart from an entity that cannot be read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Exceeded;

impl From<Exceeded> for String {
    fn from(Exceeded: Exceeded) -> Self {
        format!("it takes more than {STEPS_OF_ENTITY} steps to draw: simplify it in the drawing program")
    }
}

impl From<Exceeded> for Cow<'static, str> {
    fn from(exceeded: Exceeded) -> Self {
        String::from(exceeded).into()
    }
}

impl Budget {
    /// A budget for a drawing that is read at this pace.
    pub(super) fn new(pace: Pace) -> Self {
        Self { pace, ..Self::default() }
    }

    /// Spends so many, or nothing if there are not as many left.
    pub(super) fn spend(&mut self, cost: Cost, count: usize) -> Result<(), Exceeded> {
        self.foresee(cost, count)?;
        self.spent[cost as usize] += count;
        Ok(())
    }

    /// Refuses so many before they are there.
    pub(super) fn foresee(&mut self, cost: Cost, count: usize) -> Result<(), Exceeded> {
        let spent = self.spent[cost as usize].saturating_add(count);
        let is_too_many = spent > cost.limit();
        if is_too_many || !self.pace.allows(spent, cost.moment()) {
            self.takes_long |= !is_too_many;
            self.exceeded.get_or_insert(cost);
            return Err(Exceeded);
        }
        Ok(())
    }

    /// Whether the drawing was refused only because it is more than a moment's work.
    pub(super) fn takes_long(&self) -> bool {
        self.takes_long
    }

    /// Steps of work on the entity that is being read.
    pub(super) fn work(&mut self, steps: usize) -> Result<(), Exceeded> {
        let of_entity = (self.spent(Cost::Steps) - self.steps_before).saturating_add(steps);
        if of_entity > STEPS_OF_ENTITY {
            return Err(Exceeded);
        }
        self.spend(Cost::Steps, steps)
    }

    /// Segments or dots of the entity that is being read.
    pub(super) fn hold(&mut self, pieces: usize) -> Result<(), Exceeded> {
        self.spend(Cost::Held, pieces)?;
        self.work(pieces * STEPS_OF_SEGMENT)
    }

    /// From here on work is that on another entity.
    pub(super) fn begin_entity(&mut self) {
        self.steps_before = self.spent(Cost::Steps);
    }

    pub(super) fn spent(&self, cost: Cost) -> usize {
        self.spent[cost as usize]
    }

    /// Gives back what is held beyond so many segments and dots.
    pub(super) fn release(&mut self, held: usize) {
        self.spent[Cost::Held as usize] = held;
    }

    /// What the drawing has too much of.
    pub(super) fn exceeded(&self) -> Option<Cost> {
        self.exceeded
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_too_much_is_not_spent_and_remembered() {
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
    fn what_takes_long_is_told_from_what_is_too_much() {
        for (count, takes_long) in [(Cost::Drawn.moment() + 1, true), (usize::MAX, false)] {
            let mut budget = Budget::new(Pace::Quick);
            assert_eq!(budget.foresee(Cost::Drawn, count), Err(Exceeded));
            assert_eq!((budget.takes_long(), budget.spent(Cost::Drawn)), (takes_long, 0));
        }
    }

    #[test]
    fn one_entity_gets_a_share_of_the_work() {
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
