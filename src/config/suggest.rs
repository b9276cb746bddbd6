//! The known name that a misspelt name probably means.

use strsim::osa_distance;

/// The names in backticks, as a list for people.
pub(super) fn listed(names: &[impl AsRef<str>]) -> String {
    let quoted: Vec<String> = names.iter().map(|name| format!("`{}`", name.as_ref())).collect();
    quoted.join(", ")
}

/// The name nearest to `given`, if it differs in at most half of its letters.
pub(super) fn nearest<'a, T: AsRef<str>>(given: &str, names: &'a [T]) -> Option<&'a str> {
    near(given, names).into_iter().next()
}

/// The names that differ from `given` in less than half of their letters, the nearest first.
pub(crate) fn near<'a, T: AsRef<str>>(given: &str, names: &'a [T]) -> Vec<&'a str> {
    let near = by_distance(given, names).into_iter();
    near.filter(|(distance, name)| distance * 2 <= name.chars().count()).map(|(_, name)| name).collect()
}

/// All names, the nearest to `given` first.
#[cfg(feature = "station")]
pub(crate) fn nearest_first<'a, T: AsRef<str>>(given: &str, names: &'a [T]) -> Vec<&'a str> {
    by_distance(given, names).into_iter().map(|(_, name)| name).collect()
}

/// All names with the number of letters in which they differ from `given`, the nearest first.
fn by_distance<'a, T: AsRef<str>>(given: &str, names: &'a [T]) -> Vec<(usize, &'a str)> {
    let given = given.to_lowercase();
    let distance = |name: &'a T| (osa_distance(&given, &name.as_ref().to_lowercase()), name.as_ref());
    let mut names: Vec<(usize, &str)> = names.iter().map(distance).collect();
    names.sort_by_key(|(distance, _)| *distance);
    names
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_name_is_near() {
        let names = ["hot", "import", "archive", "rejected"];
        let cases = [
            ("imprt", Some("import")),
            ("improt", Some("import")),
            ("Import", Some("import")),
            ("ipmort_folder", None),
        ];
        for (given, expected) in cases {
            assert_eq!(nearest(given, &names), expected, "{given}");
        }
    }
}
