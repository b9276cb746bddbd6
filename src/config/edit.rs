//! Changes of single settings in the text of a file that people wrote: comments, order and spelling of all else are kept.

use toml_edit::{Array, DocumentMut, Item, Table, TableLike, Value, value};

/// A new value of a setting.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum NewValue {
    /// A number.
    Number(f64),
    /// A pair of numbers.
    Pair([f64; 2]),
    /// A text.
    Text(String),
    /// No value: the key is removed.
    Nothing,
}

impl NewValue {
    fn value(&self) -> Option<Value> {
        Some(match self {
            Self::Number(number) => (*number).into(),
            Self::Pair(numbers) => Array::from_iter(*numbers).into(),
            Self::Text(text) => text.as_str().into(),
            Self::Nothing => return None,
        })
    }

    /// The line of a settings file that gives the value; `None` for no value.
    #[must_use]
    pub fn line(&self, key: &str) -> Option<String> {
        Some(format!("{key} = {}", self.value()?))
    }
}

/// The text with these keys of a table changed or removed. The table is added if it does not exist.
///
/// # Errors
/// When the text is not TOML, or the table is something else there; the error is a sentence for people.
pub fn edited(text: &str, table: &str, changes: &[(&str, NewValue)]) -> Result<String, String> {
    let (mark, text) = match text.strip_prefix('\u{feff}') {
        Some(rest) => ("\u{feff}", rest),
        None => ("", text),
    };
    let mut document: DocumentMut = text.parse().map_err(|error| format!("The text is not TOML: {error}"))?;
    let keys = document.entry(table).or_insert_with(|| Item::Table(Table::new()));
    let keys = keys.as_table_like_mut().ok_or_else(|| format!("`{table}` is not a table."))?;
    for (key, new) in changes {
        match (new.value(), keys.get_mut(key)) {
            (Some(mut new), Some(Item::Value(old))) => {
                *new.decor_mut() = old.decor().clone();
                *old = new;
            }
            (Some(new), _) => {
                keys.insert(key, value(new));
            }
            (None, _) => remove(keys, key),
        }
    }
    let written = document.to_string();
    let written = match text.contains("\r\n") {
        true => written.replace("\r\n", "\n").replace('\n', "\r\n"),
        false => written,
    };
    Ok(format!("{mark}{written}"))
}

/// Removes a key; the comment lines above it then stand above the next key.
fn remove(keys: &mut dyn TableLike, key: &str) {
    let comments = keys.key(key).and_then(|key| key.leaf_decor().prefix()).and_then(|prefix| prefix.as_str());
    let comments = comments.unwrap_or_default().to_owned();
    let names: Vec<String> = keys.iter().map(|(name, _)| name.to_owned()).collect();
    keys.remove(key);
    let next = names.iter().skip_while(|name| *name != key).nth(1);
    if let Some(mut next) = next.and_then(|next| keys.key_mut(next)) {
        let decor = next.leaf_decor_mut();
        let own = decor.prefix().and_then(|prefix| prefix.as_str()).unwrap_or_default();
        let both = format!("{comments}{own}");
        decor.set_prefix(both);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STATION: &str = "# A station.\n[optics]\n# What the lens is.\nkind = \"telecentric\"   # or another\n\
                           # axis_mm = [0, 0]\nfocus_depth_mm = 4 # mm\n\n# The rest.\n[part]\nunit = \"mm\"\n";

    #[test]
    fn a_changed_key_keeps_all_comments() {
        let changes = [
            ("kind", NewValue::Text("perspective".into())),
            ("lens_distance_x_mm", NewValue::Number(300.25)),
            ("axis_mm", NewValue::Pair([1.0, -2.5])),
        ];
        let found = edited(STATION, "optics", &changes).unwrap();
        let expected = STATION
            .replace("telecentric", "perspective")
            .replace("4 # mm\n", "4 # mm\nlens_distance_x_mm = 300.25\naxis_mm = [1.0, -2.5]\n");
        assert_eq!(found, expected);
        // Windows' line ends and byte order mark stay, too.
        let windows = format!("\u{feff}{}", STATION.replace('\n', "\r\n"));
        let found = edited(&windows, "optics", &changes).unwrap();
        assert_eq!(found, format!("\u{feff}{}", expected.replace('\n', "\r\n")));
        assert_eq!(edited(&expected, "optics", &changes).unwrap(), expected);
    }

    #[test]
    fn a_removed_key_leaves_its_comments_and_a_missing_table_is_added() {
        let found = edited(STATION, "optics", &[("kind", NewValue::Nothing)]).unwrap();
        assert!(found.contains("# What the lens is.\n# axis_mm = [0, 0]\nfocus_depth_mm"), "{found}");
        let found = edited("[part]\nunit = \"mm\"\n", "fixture", &[("x_mm", NewValue::Number(2.0))]).unwrap();
        assert_eq!(found, "[part]\nunit = \"mm\"\n\n[fixture]\nx_mm = 2.0\n");
        let inline =
            edited("fixture = { y_mm = 1 } # here\n", "fixture", &[("x_mm", NewValue::Number(2.0))]).unwrap();
        assert!(inline.parse::<toml::Table>().is_ok() && inline.contains("# here"), "{inline}");
        assert!(edited("fixture = 1", "fixture", &[]).is_err() && edited("=", "fixture", &[]).is_err());
    }
}
