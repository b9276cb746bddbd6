//! GS1 element strings, written with their application identifiers in parentheses: `(01)04012345678901(21)17`.

use super::error::{CodeError, SEPARATOR};

/// Application identifiers whose elements have a fixed length, by their first two digits, with the length of identifier and
/// data together (GS1 General Specifications, section 7.8.5). All other elements end with a separator.
const FIXED: &[(&str, usize)] = &[
    ("00", 20),
    ("01", 16),
    ("02", 16),
    ("03", 16),
    ("04", 18),
    ("11", 8),
    ("12", 8),
    ("13", 8),
    ("14", 8),
    ("15", 8),
    ("16", 8),
    ("17", 8),
    ("18", 8),
    ("19", 8),
    ("20", 4),
    ("31", 10),
    ("32", 10),
    ("33", 10),
    ("34", 10),
    ("35", 10),
    ("36", 10),
    ("41", 16),
];
/// Longest data of an element of variable length.
const LONGEST: usize = 90;
/// Elements that end with a check digit.
const CHECKED: [&str; 3] = ["00", "01", "02"];
/// The letters of GS1 elements besides letters and digits (set 82).
const SIGNS: &str = "!\"%&'()*+,-./_:;<=>?";

/// The bytes of all elements, with separators where they are needed.
///
/// # Errors
/// When the text is not written as elements, or an element is not valid.
pub(super) fn elements(text: &str) -> Result<Vec<u8>, CodeError> {
    let wrong = |what: String| CodeError::Gs1(what);
    let mut rest = text;
    let mut bytes = Vec::new();
    let mut is_open = false;
    while !rest.is_empty() {
        let parts = rest.strip_prefix('(').and_then(|rest| rest.split_once(')'));
        let (identifier, after) = parts
            .filter(|(identifier, _)| {
                (2..=4).contains(&identifier.len()) && identifier.bytes().all(|byte| byte.is_ascii_digit())
            })
            .ok_or_else(|| {
                wrong(format!("`{rest}` does not begin with an application identifier such as (01)"))
            })?;
        let end = after.match_indices('(').map(|(at, _)| at).find(|at| {
            let identifier = after[at + 1..].split(')').next().unwrap_or_default();
            (2..=4).contains(&identifier.len())
                && identifier.bytes().all(|byte| byte.is_ascii_digit())
                && after[at + 1..].contains(')')
        });
        let (data, next) = after.split_at(end.unwrap_or(after.len()));
        rest = next;
        let fixed = FIXED.iter().find(|(start, _)| identifier.starts_with(start));
        match fixed {
            Some((_, length)) => {
                let digits = length - identifier.len();
                if data.len() != digits || !data.bytes().all(|byte| byte.is_ascii_digit()) {
                    return Err(wrong(format!("({identifier}) needs {digits} digits and has `{data}`")));
                }
                if CHECKED.contains(&identifier) && check_digit(&data[..digits - 1]) != data.bytes().last() {
                    let right = char::from(check_digit(&data[..digits - 1]).unwrap_or(b'0'));
                    return Err(wrong(format!("the check digit of ({identifier}){data} must be {right}")));
                }
            }
            None if data.is_empty() || data.len() > LONGEST => {
                return Err(wrong(format!(
                    "({identifier}) needs 1 to {LONGEST} characters and has {}",
                    data.len()
                )));
            }
            None => {}
        }
        if let Some(letter) =
            data.chars().find(|letter| !letter.is_ascii_alphanumeric() && !SIGNS.contains(*letter))
        {
            return Err(wrong(format!("({identifier}) contains {letter:?}, which GS1 elements do not have")));
        }
        if is_open {
            bytes.push(SEPARATOR);
        }
        is_open = fixed.is_none();
        bytes.extend(identifier.bytes().chain(data.bytes()));
    }
    Ok(bytes)
}

/// The check digit of these digits: weights 3 and 1 from the right.
fn check_digit(digits: &str) -> Option<u8> {
    let weights = [3, 1].into_iter().cycle();
    let sum: u32 =
        digits.bytes().rev().zip(weights).map(|(digit, weight)| u32::from(digit - b'0') * weight).sum();
    u8::try_from((10 - sum % 10) % 10).ok().map(|digit| digit + b'0')
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn separators_follow_elements_of_variable_length() {
        // The example of the GS1 DataMatrix guideline: GTIN, expiry date, lot, serial number.
        let text = "(01)09501101020917(17)261231(10)ABC123(21)17";
        assert_eq!(
            elements(text).unwrap(),
            b"010950110102091717261231".iter().chain(b"10ABC123\x1d2117").copied().collect::<Vec<_>>()
        );
        assert_eq!(elements("(10)A(B)C").unwrap(), b"10A(B)C");
    }

    #[test]
    fn elements_that_are_not_valid_are_refused() {
        for (text, words) in [
            ("17", "does not begin with an application identifier"),
            ("(1)7", "does not begin"),
            ("(01)123", "needs 14 digits"),
            ("(01)09501101020918", "check digit of (01)09501101020918 must be 7"),
            ("(21)", "needs 1 to 90 characters"),
            ("(21)a b", "contains ' '"),
            ("(01", "does not begin"),
            ("(21)ä", "contains 'ä'"),
        ] {
            let error = elements(text).unwrap_err().to_string();
            assert!(error.contains(words), "{text}: {error}");
        }
    }
}
