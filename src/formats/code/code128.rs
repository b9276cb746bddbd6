//! Code 128 (ISO/IEC 15417).

use super::error::SEPARATOR;

/// Most modules of a code; longer ones cannot be read by scanners.
pub(super) const LONGEST: usize = 2000;

/// Widths of the bars and spaces of each symbol character, by its value.
const WIDTHS: [&str; 107] = [
    "212222", "222122", "222221", "121223", "121322", "131222", "122213", "122312", "132212", "221213",
    "221312", "231212", "112232", "122132", "122231", "113222", "123122", "123221", "223211", "221132",
    "221231", "213212", "223112", "312131", "311222", "321122", "321221", "312212", "322112", "322211",
    "212123", "212321", "232121", "111323", "131123", "131321", "112313", "132113", "132311", "211313",
    "231113", "231311", "112133", "112331", "132131", "113123", "113321", "133121", "313121", "211331",
    "231131", "213113", "213311", "213131", "311123", "311321", "331121", "312113", "312311", "332111",
    "314111", "221411", "431111", "111224", "111422", "121124", "121421", "141122", "141221", "112214",
    "112412", "122114", "122411", "142112", "142211", "241211", "221114", "413111", "241112", "134111",
    "111242", "121142", "121241", "114212", "124112", "124211", "411212", "421112", "421211", "212141",
    "214121", "412121", "111143", "111341", "131141", "114113", "114311", "411113", "411311", "113141",
    "114131", "311141", "411131", "211412", "211214", "211232", "2331112",
];
const TO_C: usize = 99;
const TO_B: usize = 100;
const FNC1: usize = 102;
const START_B: usize = 104;
const START_C: usize = 105;
const STOP: usize = 106;
/// Digits from which on a pair for each symbol is shorter: at the beginning or end, and between letters.
const RUN_AT_END: usize = 4;
const RUN_WITHIN: usize = 6;

/// The modules of bars and spaces. With `gs1`, FNC1 is in front and in the place of each separator.
///
/// # Errors
/// The byte that the code lacks.
pub(super) fn modules(content: &[u8], gs1: bool) -> Result<Vec<bool>, u8> {
    let digits = |from: usize| content[from..].iter().take_while(|byte| byte.is_ascii_digit()).count();
    let first = digits(0);
    let mut in_pairs = first >= RUN_AT_END || first == 2 && content.len() == 2;
    let mut values = vec![if in_pairs { START_C } else { START_B }];
    if gs1 {
        values.push(FNC1);
    }
    let mut at = 0;
    while let Some(byte) = content.get(at).copied() {
        let run = digits(at);
        if gs1 && byte == SEPARATOR {
            values.push(FNC1);
            at += 1;
            continue;
        }
        if in_pairs && run < 2 {
            values.push(TO_B);
            in_pairs = false;
        }
        let is_long = run >= if at + run == content.len() { RUN_AT_END } else { RUN_WITHIN };
        if !in_pairs && is_long && run % 2 == 0 {
            values.push(TO_C);
            in_pairs = true;
        }
        match byte {
            tens if in_pairs => {
                let ones = content.get(at + 1).copied().unwrap_or(b'0');
                values.push(usize::from(tens - b'0') * 10 + usize::from(ones - b'0'));
                at += 2;
            }
            b' '..=b'~' => {
                values.push(usize::from(byte - b' '));
                at += 1;
            }
            other => return Err(other),
        }
    }
    let check = values.iter().enumerate().map(|(place, value)| place.max(1) * value).sum::<usize>() % 103;
    values.extend([check, STOP]);
    let mut modules = Vec::with_capacity(values.len() * 11 + 2);
    for value in values {
        for (index, width) in WIDTHS[value].bytes().enumerate() {
            modules.extend(std::iter::repeat_n(index % 2 == 0, usize::from(width - b'0')));
        }
    }
    Ok(modules)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn symbol_characters_have_eleven_modules_and_differ() {
        for (value, widths) in WIDTHS.iter().enumerate() {
            let sum: u32 = widths.bytes().map(|width| u32::from(width - b'0')).sum();
            assert_eq!(sum, if value == STOP { 13 } else { 11 });
            // The bars of a symbol character have an even number of modules.
            let bars: u32 = widths.bytes().take(6).step_by(2).map(|width| u32::from(width - b'0')).sum();
            assert_eq!(bars % 2, 0, "{value}");
            assert!(WIDTHS[..value].iter().all(|other| other != widths));
        }
    }

    #[test]
    fn pairs_of_digits_are_one_symbol() {
        let symbols = |text: &str| (modules(text.as_bytes(), false).unwrap().len() - 13) / 11 - 2;
        assert_eq!(symbols("123456"), 3);
        assert_eq!(symbols("12345"), 4);
        assert_eq!(symbols("AB123456"), 2 + 1 + 3);
        assert_eq!(symbols("A123456B"), 1 + 1 + 3 + 1 + 1);
        assert_eq!(symbols("A1234B"), 6);
        assert_eq!(modules(b"a\x01", false), Err(1));
    }
}
