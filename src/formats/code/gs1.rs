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
const CHECKED: [&str; 12] = ["00", "01", "02", "03", "410", "411", "412", "413", "414", "415", "416", "417"];
/// Elements that are a date, with the year, month and day as two digits each.
const DATES: [&str; 6] = ["11", "12", "13", "15", "16", "17"];
/// The number of digits of an application identifier, by its first two digits; others are not assigned (GS1 General
/// Specifications, section 3.2).
const IDENTIFIERS: &[(&str, usize)] = &[
    ("00", 2),
    ("01", 2),
    ("02", 2),
    ("03", 2),
    ("10", 2),
    ("11", 2),
    ("12", 2),
    ("13", 2),
    ("15", 2),
    ("16", 2),
    ("17", 2),
    ("20", 2),
    ("21", 2),
    ("22", 2),
    ("23", 3),
    ("24", 3),
    ("25", 3),
    ("30", 2),
    ("31", 4),
    ("32", 4),
    ("33", 4),
    ("34", 4),
    ("35", 4),
    ("36", 4),
    ("37", 2),
    ("39", 4),
    ("40", 3),
    ("41", 3),
    ("42", 3),
    ("43", 4),
    ("70", 4),
    ("71", 3),
    ("72", 4),
    ("80", 4),
    ("81", 4),
    ("82", 4),
    ("90", 2),
    ("91", 2),
    ("92", 2),
    ("93", 2),
    ("94", 2),
    ("95", 2),
    ("96", 2),
    ("97", 2),
    ("98", 2),
    ("99", 2),
];
/// Common elements of variable length, with their longest data, and whether it is digits only.
const LIMITS: &[(&str, usize, bool)] = &[
    ("10", 20, false),
    ("21", 20, false),
    ("22", 20, false),
    ("235", 28, false),
    ("240", 30, false),
    ("241", 30, false),
    ("242", 6, true),
    ("243", 20, false),
    ("250", 30, false),
    ("251", 30, false),
    ("254", 20, false),
    ("30", 8, true),
    ("37", 8, true),
    ("390", 15, true),
    ("392", 15, true),
    ("400", 30, false),
    ("401", 30, false),
    ("403", 30, false),
    ("420", 20, false),
    ("710", 20, false),
    ("8004", 30, false),
    ("8200", 70, false),
    ("90", 30, false),
];
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
        match IDENTIFIERS.iter().find(|(start, _)| identifier.starts_with(start)) {
            Some((_, length)) if *length == identifier.len() => {}
            Some((start, length)) => {
                let what = format!("application identifiers that begin with {start} have {length} digits");
                return Err(wrong(format!("({identifier}) is not assigned: {what}")));
            }
            None => return Err(wrong(format!("({identifier}) is not an application identifier of GS1"))),
        }
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
                if DATES.contains(&identifier) && !is_date(data) {
                    let what = "year, month and day, as in 261231; day 00 leaves the day open";
                    return Err(wrong(format!("({identifier}){data} is not a date: write {what}")));
                }
            }
            None => {
                let limit = LIMITS.iter().find(|(start, ..)| identifier.starts_with(start));
                let (longest, is_number) =
                    limit.map_or((LONGEST, false), |(_, longest, is_number)| (*longest, *is_number));
                let what = if is_number { "digits" } else { "characters" };
                if data.is_empty() || data.len() > longest {
                    return Err(wrong(format!(
                        "({identifier}) needs 1 to {longest} {what} and has {}",
                        data.len()
                    )));
                }
                if is_number && !data.bytes().all(|byte| byte.is_ascii_digit()) {
                    return Err(wrong(format!(
                        "({identifier}) needs 1 to {longest} digits and has `{data}`"
                    )));
                }
            }
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

/// Whether six digits are a date. Day 00 leaves the day of the month open.
fn is_date(digits: &str) -> bool {
    let number = |at: usize| digits.get(at..at + 2).and_then(|part| part.parse::<u32>().ok());
    let (Some(year), Some(month), Some(day)) = (number(0), number(2), number(4)) else { return false };
    let last = match month {
        // 2000 is a leap year, and 1900 and 2100 are out of reach: a year is at most 50 years away.
        2 if year.is_multiple_of(4) => 29,
        2 => 28,
        4 | 6 | 9 | 11 => 30,
        _ => 31,
    };
    (1..=12).contains(&month) && day <= last
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
        // Open days, a leap day, and elements that this program does not know in detail.
        for text in
            ["(17)260200", "(17)280229", "(15)261130", "(3103)001750", "(8008)26123112", "(98)x", "(4300)A"]
        {
            assert!(elements(text).is_ok(), "{text}");
        }
    }

    #[test]
    fn elements_that_are_not_valid_are_refused() {
        for (text, words) in [
            ("17", "does not begin with an application identifier"),
            ("(1)7", "does not begin"),
            ("(01)123", "needs 14 digits"),
            ("(01)09501101020918", "check digit of (01)09501101020918 must be 7"),
            ("(21)", "needs 1 to 20 characters"),
            ("(98)", "needs 1 to 90 characters"),
            ("(10)ABCDEFGHIJKLMNOPQRSTU", "needs 1 to 20 characters and has 21"),
            ("(37)123456789", "needs 1 to 8 digits and has 9"),
            ("(30)1A", "needs 1 to 8 digits and has `1A`"),
            ("(17)269945", "(17)269945 is not a date"),
            ("(11)260229", "is not a date"),
            ("(13)261301", "is not a date"),
            ("(414)4012345000000", "check digit of (414)4012345000000 must be 9"),
            ("(05)12", "(05) is not an application identifier"),
            ("(310)0001750", "begin with 31 have 4 digits"),
            ("(0112)1", "begin with 01 have 2 digits"),
            ("(21)a b", "contains ' '"),
            ("(01", "does not begin"),
            ("(21)ä", "contains 'ä'"),
        ] {
            let error = elements(text).unwrap_err().to_string();
            assert!(error.contains(words), "{text}: {error}");
        }
    }
}
