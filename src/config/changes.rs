//! What changed between two versions of a settings file, for the log.

use toml::{Table, Value};

/// The settings of a file by their names, `table.key`, in the order of the names.
fn settings(text: &str) -> Option<Vec<(String, String)>> {
    let mut found = Vec::new();
    for (name, value) in text.trim_start_matches('\u{feff}').parse::<Table>().ok()? {
        match value {
            Value::Table(keys) => {
                found.extend(
                    keys.into_iter().map(|(key, value)| (format!("{name}.{key}"), value.to_string())),
                );
            }
            value => found.push((name, value.to_string())),
        }
    }
    found.sort();
    Some(found)
}

/// The settings that differ, as one line: `part.shape = "cone", part.axis removed`. Comments and blank lines change nothing.
pub(crate) fn changed_settings(old: &str, new: &str) -> String {
    let (Some(old), Some(new)) = (settings(old), settings(new)) else {
        return "the file changed".to_owned();
    };
    let value = |all: &[(String, String)], name: &str| {
        all.iter().find(|(known, _)| known == name).map(|(_, value)| value.clone())
    };
    let mut changes = Vec::new();
    for (name, given) in &new {
        match value(&old, name) {
            Some(before) if before == *given => {}
            Some(before) => changes.push(format!("{name} = {given} (before: {before})")),
            None => changes.push(format!("{name} = {given}")),
        }
    }
    changes.extend(
        old.iter().filter(|(name, _)| value(&new, name).is_none()).map(|(name, _)| format!("{name} removed")),
    );
    match changes.is_empty() {
        true => "only comments changed".to_owned(),
        false => changes.join(", "),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn changed_settings_have_their_names_and_nothing_else() {
        for (old, new, changes) in [
            ("", "\n# a cone\n[part]\nshape = \"cone\" # tapered\n", "part.shape = \"cone\""),
            (
                "[part]\nroll_deg = 2\nup = \"y\"\n",
                "[part]\nroll_deg = 3\n\n[fill]\nspacing_mm = 0.5\n",
                "fill.spacing_mm = 0.5, part.roll_deg = 3 (before: 2), part.up removed",
            ),
            ("[part]\nroll_deg = 2\n", "# comment\n\n[part]\nroll_deg = 2 # deg\n", "only comments changed"),
            ("part = ", "[part]\n", "the file changed"),
        ] {
            assert_eq!(changed_settings(old, new), changes);
        }
    }
}
