//! The settings of one row of a list, as a file beside its drawing.

use std::collections::BTreeMap;

use toml_edit::{DocumentMut, InlineTable, Item, Table, value};

/// The text of a settings file with the values of one product added to `[content]`; comments are kept. `None` if the text is not TOML,
/// or the number is too large for it.
pub(crate) fn with_row(
    text: &str,
    serial: u64,
    date: &str,
    row: &BTreeMap<String, String>,
) -> Option<String> {
    let mut document: DocumentMut = text.parse().ok()?;
    let content = document.entry("content").or_insert_with(|| Item::Table(Table::new()));
    let content = content.as_table_like_mut()?;
    content.insert("serial", value(i64::try_from(serial).ok()?));
    content.insert("date", value(date));
    let columns: InlineTable = row.iter().map(|(name, value)| (name.as_str(), value.as_str())).collect();
    content.insert("csv", value(columns));
    Some(document.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::JobSettings;

    #[test]
    fn a_row_is_read_back_with_the_settings_around_it() {
        let row = BTreeMap::from([("LOT no".to_owned(), "A\"7\\ \u{e9}".to_owned())]);
        for (text, turn) in [
            ("", 0.0),
            ("# kept\n[placement]\nrotate_deg = 90\n", 90.0),
            ("content = { shift = \"late\" }\n", 0.0),
            ("[content]\nserial = 3 # older\n", 0.0),
        ] {
            let with_values = with_row(text, 17, "2026-11-23T14:05:00", &row).unwrap();
            let settings = JobSettings::default();
            let read = settings.with_sidecar(std::path::Path::new("row.toml"), &with_values).unwrap();
            assert_eq!(read.content.values.serial, Some(17), "{with_values}");
            assert_eq!(read.content.values.row, row, "{with_values}");
            assert_eq!(read.content.values.date, "2026-11-23T14:05".parse().ok(), "{with_values}");
            assert!((read.placement.rotate.to_degrees() - turn).abs() < 1e-9, "{with_values}");
            assert_eq!(with_values.contains("# kept"), text.contains("# kept"), "{with_values}");
        }
        assert_eq!(with_row("[content", 1, "2026-11-23", &row), None);
        assert_eq!(with_row("", u64::MAX, "2026-11-23", &row), None);
    }
}
