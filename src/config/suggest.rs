//! The known name that a misspelt name probably means.

use strsim::osa_distance;

/// The names in backticks, as a list for people.
pub(super) fn listed(names: &[impl AsRef<str>]) -> String {
    let quoted: Vec<String> = names.iter().map(|name| format!("`{}`", name.as_ref())).collect();
    quoted.join(", ")
}

/// The name nearest to `given`, if it differs in at most half of its letters.
pub(super) fn nearest<'a, T: AsRef<str>>(given: &str, names: &'a [T]) -> Option<&'a str> {
    let given = given.to_lowercase();
    let distances =
        names.iter().map(|name| (osa_distance(&given, &name.as_ref().to_lowercase()), name.as_ref()));
    let (distance, name) = distances.min_by_key(|(distance, _)| *distance)?;
    (distance * 2 <= name.chars().count()).then_some(name)
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
