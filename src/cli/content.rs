//! Options for content that differs from product to product.

use std::collections::BTreeSet;

use chrono::Local;
use clap::Args;

use super::outcome::{Failure, Outcome};
use crate::config::JobSettings;
use crate::formats::pattern::Moment;

const CONTENT: &str = "Variable content";

#[derive(Debug, Args)]
pub(super) struct ContentArguments {
    /// The value of a field of the drawing: serial=17, shift=early, or csv.COLUMN=TEXT; may be repeated.
    #[arg(long, value_name = "FIELD=VALUE", help_heading = CONTENT)]
    content: Vec<String>,
    /// Date of the mark for `{date}` and for the shift, such as 2026-11-23 or 2026-11-23T14:05. Default: the computer's clock.
    #[arg(long, value_name = "DATE", help_heading = CONTENT)]
    date: Option<String>,
}

impl ContentArguments {
    /// Puts the given values into the settings, and the clock's date if none is given.
    pub(super) fn add_to(&self, settings: &mut JobSettings) -> Outcome {
        let values = &mut settings.content.values;
        if let Some(date) = &self.date {
            let date = date.parse().map_err(|()| {
                Failure::usage(
                    format!("`--date {date}` is not a date."),
                    "Give the year with four digits, month and day, with a time if need be, as in 2026-11-23 or 2026-11-23T14:05.",
                )
            })?;
            values.date = Some(date);
        }
        values.date.get_or_insert_with(|| Moment::new(Local::now().naive_local()));
        let mut known = BTreeSet::new();
        for given in &self.content {
            let wrong = |what: &str| {
                Failure::usage(
                    format!("`--content {given}` {what}."),
                    "Give a field and its value: serial=17, shift=early or csv.COLUMN=TEXT; the date with `--date`.",
                )
            };
            let (field, value) = given.split_once('=').ok_or_else(|| wrong("gives no value"))?;
            match field.split_once('.') {
                None if field == "serial" => {
                    values.serial = Some(
                        value
                            .parse()
                            .map_err(|_| wrong(&format!("gives no whole number from 0 to {}", u64::MAX)))?,
                    );
                }
                None if field == "shift" => values.shift = Some(value.into()),
                Some(("csv", column)) if !column.is_empty() => {
                    values.row.insert(column.into(), value.into());
                }
                _ => return Err(wrong("names no field")),
            }
            if !known.insert(field) {
                return Err(wrong("gives the field again"));
            }
        }
        Ok(())
    }

    /// Whether a serial number or a value of a column is given.
    pub(super) fn gives_a_product(&self) -> bool {
        self.content.iter().any(|given| !given.starts_with("shift="))
    }
}
