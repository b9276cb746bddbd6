//! The settings of content that differs from product to product: serial numbers, shifts, codes and lists.

use super::choices::BadRows;
use crate::formats::code::Kind;
use crate::formats::pattern::is_same_layer;
use crate::formats::pattern::{Content, Moment};

/// The content that differs from product to product.
#[derive(Debug, Clone, Default, PartialEq)]
#[non_exhaustive]
pub struct ContentSettings {
    /// The values of one product; those that are not given here have none.
    pub values: Content,
    /// The serial numbers of a list.
    pub serial: SerialSettings,
    /// The shifts, by the minute of the day at which they begin.
    pub shifts: Vec<ShiftSettings>,
    /// The codes that are drawn into placeholders.
    pub codes: Vec<CodeSettings>,
    /// What is done when rows of a list cannot be marked.
    pub bad_rows: BadRows,
}

impl ContentSettings {
    /// The values of one product, with its SKU and with the shift at its date.
    #[must_use]
    pub fn values_of(&self, sku: &str) -> Content {
        let mut values = self.values.clone();
        values.sku.get_or_insert_with(|| sku.to_owned());
        values.shift = values.shift.or_else(|| Some(self.shift_at(values.date?)?.to_owned()));
        values
    }

    /// The shift at a moment: the last one that began before it, if need be on the day before.
    fn shift_at(&self, moment: Moment) -> Option<&str> {
        let started = self.shifts.iter().filter(|shift| shift.from <= moment.minutes());
        let last = |shifts: &mut dyn Iterator<Item = &'_ ShiftSettings>| shifts.map(|shift| shift.from).max();
        let from = last(&mut started.into_iter()).or_else(|| last(&mut self.shifts.iter()))?;
        self.shifts.iter().find(|shift| shift.from == from).map(|shift| shift.name.as_str())
    }
}

/// Serial numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub struct SerialSettings {
    /// The first number.
    pub start: u64,
    /// The distance of two numbers.
    pub step: u64,
    /// The last number that may be used; `None` for no limit.
    pub last: Option<u64>,
}

impl Default for SerialSettings {
    fn default() -> Self {
        Self { start: 1, step: 1, last: None }
    }
}

impl SerialSettings {
    /// The number of the product with this index from 0; `None` beyond the last one.
    #[must_use]
    pub fn number(&self, index: u64) -> Option<u64> {
        let number = self.start.checked_add(self.step.checked_mul(index)?)?;
        Some(number).filter(|number| self.last.is_none_or(|last| *number <= last))
    }
}

/// A shift.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct ShiftSettings {
    /// Its name on the product.
    pub name: String,
    /// When it begins, minutes since midnight.
    pub from: u32,
}

/// The rectangles that a code replaces.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum Placeholder {
    /// Those on a layer.
    Layer(String),
    /// Those in the definition of a block; in an SVG, those that a copy (`use`) of the element with this name draws.
    Block(String),
}

impl Placeholder {
    /// Whether it means this layer or block. Capital and small letters are equal.
    #[must_use]
    pub fn is_at(&self, layer: &str, block: Option<&str>) -> bool {
        match self {
            Self::Layer(name) => is_same_layer(name, layer),
            Self::Block(name) => block.is_some_and(|block| is_same_layer(name, block)),
        }
    }
}

impl std::fmt::Display for Placeholder {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Layer(name) => write!(out, "the layer {name}"),
            Self::Block(name) => write!(out, "the block {name}"),
        }
    }
}

/// A code in placeholders.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct CodeSettings {
    /// Where its rectangles are.
    pub placeholder: Placeholder,
    /// Its kind.
    pub kind: Kind,
    /// Its content, with fields such as `{serial:06}`.
    pub content: String,
    /// Width of the quiet zone inside the rectangle, modules; `None` for that of the standard.
    pub quiet_zone: Option<usize>,
    /// Whether the light modules are marked, for marks that are lighter than the part.
    pub is_inverted: bool,
    /// Whether a Data Matrix may be longer than high.
    pub is_rectangular: bool,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_shift_lasts_until_the_next_one_begins() {
        let shift = |name: &str, from| ShiftSettings { name: name.into(), from };
        let shifts = vec![shift("early", 360), shift("late", 840), shift("night", 1320)];
        let settings = ContentSettings { shifts, ..ContentSettings::default() };
        let at = |text: &str| settings.shift_at(text.parse().unwrap());
        assert_eq!(at("2026-11-23T05:59"), Some("night"));
        assert_eq!(at("2026-11-23T06:00"), Some("early"));
        assert_eq!(at("2026-11-23T13:59:59"), Some("early"));
        assert_eq!(at("2026-11-23T23:00"), Some("night"));
        assert_eq!(ContentSettings::default().shift_at("2026-11-23".parse().unwrap()), None);
    }

    #[test]
    fn numbers_end_with_the_last_one() {
        let serial = SerialSettings { start: 10, step: 5, last: Some(20) };
        assert_eq!([0, 1, 2, 3].map(|index| serial.number(index)), [Some(10), Some(15), Some(20), None]);
        let endless = SerialSettings { start: u64::MAX, ..SerialSettings::default() };
        assert_eq!([0, 1].map(|index| endless.number(index)), [Some(u64::MAX), None]);
    }
}
