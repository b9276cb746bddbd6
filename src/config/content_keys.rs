//! The tables `[content]` and `[serial]`: codes, shifts and serial numbers.

use std::collections::BTreeMap;

use serde::Deserialize;
use toml::Spanned;

use super::choices::BadRows;
use super::content::{CodeSettings, Placeholder, ShiftSettings};
use super::error::ConfigError;
use super::settings::JobSettings;
use super::text::SettingsText;
use crate::formats::code::Kind;
use crate::formats::pattern::is_same_layer;

/// Most codes and shifts.
const MOST: usize = 100;
/// Widths of a quiet zone, modules.
const QUIET: std::ops::RangeInclusive<usize> = 0..=100;
/// Serial numbers and steps. TOML has no larger whole number that every program reads.
const SERIAL: std::ops::RangeInclusive<usize> = 0..=9_007_199_254_740_991;

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct ContentKeys {
    codes: Option<Spanned<Vec<CodeKeys>>>,
    csv: Option<BTreeMap<String, String>>,
    date: Option<Spanned<String>>,
    serial: Option<Spanned<usize>>,
    shift: Option<String>,
    shifts: Option<Spanned<Vec<ShiftKeys>>>,
    bad_rows: Option<BadRows>,
}

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct SerialKeys {
    start: Option<Spanned<usize>>,
    step: Option<Spanned<usize>>,
    last: Option<Spanned<usize>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct CodeKeys {
    layer: Option<String>,
    block: Option<String>,
    kind: Kind,
    content: Spanned<String>,
    quiet_zone: Option<Spanned<usize>>,
    #[serde(default)]
    invert: bool,
    #[serde(default)]
    rectangular: bool,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ShiftKeys {
    name: Spanned<String>,
    from: Spanned<String>,
}

impl ContentKeys {
    pub(super) fn apply(self, text: &SettingsText, to: &mut JobSettings) -> Result<(), ConfigError> {
        let contradiction = |span: &std::ops::Range<usize>, what: String, remedy: &str| {
            ConfigError::Contradiction { spot: text.spot(span), what, remedy: remedy.into() }
        };
        let content = &mut to.content;
        if let Some(codes) = self.codes {
            let span = codes.span();
            if codes.get_ref().len() > MOST {
                let what = format!("`content.codes` has more than {MOST} codes.");
                return Err(contradiction(&span, what, "Give fewer."));
            }
            content.codes.clear();
            for code in codes.into_inner() {
                let placeholder = match (code.layer, code.block) {
                    (Some(layer), None) => Placeholder::Layer(layer),
                    (None, Some(block)) => Placeholder::Block(block),
                    (given, _) => {
                        let how_many = if given.is_some() {
                            "both a layer and a block"
                        } else {
                            "no layer and no block"
                        };
                        let what = format!("A code of `content.codes` names {how_many}.");
                        let remedy = "Give `layer` or `block`, for the rectangles that become the code.";
                        return Err(contradiction(&span, what, remedy));
                    }
                };
                let is_again = |other: &CodeSettings| match (&other.placeholder, &placeholder) {
                    (Placeholder::Layer(one), Placeholder::Layer(other))
                    | (Placeholder::Block(one), Placeholder::Block(other)) => is_same_layer(one, other),
                    _ => false,
                };
                if content.codes.iter().any(is_again) {
                    let what = format!("`content.codes` names {placeholder} twice.");
                    return Err(contradiction(&span, what, "Give each code a layer or a block of its own."));
                }
                if code.content.get_ref().is_empty() {
                    let what = "The content of a code is empty.".into();
                    return Err(contradiction(&code.content.span(), what, "Give it, as in \"{serial:06}\"."));
                }
                if code.rectangular && code.kind != Kind::DataMatrix && code.kind != Kind::Gs1DataMatrix {
                    let what = format!("A {} code has no rectangular form.", code.kind);
                    return Err(contradiction(&span, what, "Remove `rectangular`."));
                }
                let quiet = code.quiet_zone.as_ref();
                let quiet =
                    quiet.map(|quiet| text.count("content.codes.quiet_zone", quiet, QUIET)).transpose()?;
                content.codes.push(CodeSettings {
                    placeholder,
                    kind: code.kind,
                    content: code.content.into_inner(),
                    quiet_zone: quiet,
                    is_inverted: code.invert,
                    is_rectangular: code.rectangular,
                });
            }
        }
        if let Some(shifts) = self.shifts {
            let span = shifts.span();
            if shifts.get_ref().len() > MOST {
                let what = format!("`content.shifts` has more than {MOST} shifts.");
                return Err(contradiction(&span, what, "Give fewer."));
            }
            content.shifts.clear();
            for shift in shifts.into_inner() {
                let from = minutes(shift.from.get_ref()).ok_or_else(|| {
                    let what = format!("`{}` is not a time of day.", shift.from.get_ref());
                    contradiction(&shift.from.span(), what, "Write hours and minutes, as in \"06:00\".")
                })?;
                if content.shifts.iter().any(|other| other.from == from) {
                    let what = format!("Two shifts begin at {}.", shift.from.get_ref());
                    return Err(contradiction(
                        &shift.from.span(),
                        what,
                        "Give each shift a beginning of its own.",
                    ));
                }
                let name = shift.name.get_ref();
                if name.trim().is_empty() || name.chars().any(char::is_control) {
                    let what = "A shift has no readable name.".into();
                    return Err(contradiction(&shift.name.span(), what, "Give it a name on one line."));
                }
                content.shifts.push(ShiftSettings { name: name.clone(), from });
            }
        }
        if let Some(given) = self.date {
            let date = given.get_ref().parse().map_err(|()| {
                let what = format!("`{}` is not a date.", given.get_ref());
                contradiction(
                    &given.span(),
                    what,
                    "Write the year with four digits: \"2026-11-23\" or \"2026-11-23T14:05\".",
                )
            })?;
            content.values.date = Some(date);
        }
        if let Some(serial) = &self.serial {
            content.values.serial = Some(text.count("content.serial", serial, SERIAL)? as u64);
        }
        content.values.shift = self.shift.or(content.values.shift.take());
        content.values.row = self.csv.unwrap_or(std::mem::take(&mut content.values.row));
        content.bad_rows = self.bad_rows.unwrap_or(content.bad_rows);
        Ok(())
    }
}

impl SerialKeys {
    pub(super) fn apply(self, text: &SettingsText, to: &mut JobSettings) -> Result<(), ConfigError> {
        let serial = &mut to.content.serial;
        let number = |key: &str, given: &Spanned<usize>| Ok(text.count(key, given, SERIAL)? as u64);
        if let Some(start) = &self.start {
            serial.start = number("serial.start", start)?;
        }
        if let Some(step) = &self.step {
            text.count("serial.step", step, 1..=1_000_000_000)?;
            serial.step = number("serial.step", step)?;
        }
        if let Some(last) = &self.last {
            serial.last = Some(number("serial.last", last)?);
        }
        let place = self.last.or(self.start);
        match (serial.last, place) {
            (Some(last), Some(place)) if last < serial.start => Err(ConfigError::Contradiction {
                spot: text.spot(&place.span()),
                what: format!("The last serial number {last} is less than the first one, {}.", serial.start),
                remedy: "Raise `last`, or lower `start`.".into(),
            }),
            _ => Ok(()),
        }
    }
}

/// The minutes since midnight of `06:00`.
fn minutes(text: &str) -> Option<u32> {
    let (hours, minutes) = text.split_once(':')?;
    let number = |text: &str, most: u32| {
        let is_number = (1..=2).contains(&text.len()) && text.bytes().all(|byte| byte.is_ascii_digit());
        text.parse::<u32>().ok().filter(|number| is_number && *number <= most)
    };
    Some(number(hours, 23)? * 60 + number(minutes, 59)?)
}
