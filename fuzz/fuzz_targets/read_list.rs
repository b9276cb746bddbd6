//! Any bytes as a list of products are read or refused with a place; every value of a row can be a code or is refused.

#![no_main]

use isomark::formats::code::{Kind, Modules, encode, outlines};
use isomark::formats::list::List;
use libfuzzer_sys::fuzz_target;

/// Values that become codes: encoding takes longer than reading.
const ENCODED: usize = 20;

fuzz_target!(|bytes: &[u8]| {
    let Ok(list) = List::new(bytes) else { return };
    let columns = list.columns().to_vec();
    let (mut line, mut encoded) = (0, 0);
    for row in list.flatten() {
        assert!(row.line > line, "line {} after {line}", row.line);
        line = row.line;
        assert!(columns.iter().all(|column| row.values.contains_key(column)));
        for value in row.values.values() {
            if encoded == ENCODED {
                return;
            }
            encoded += 1;
            for kind in [Kind::DataMatrix, Kind::Gs1DataMatrix, Kind::Qr, Kind::Code128, Kind::Gs1Code128] {
                if let Ok(modules) = encode(kind, value, value.len() % 2 == 0) {
                    assert_eq!(enclosed(&modules), dark(&modules), "{kind} {value:?}");
                }
            }
        }
    }
});

/// The area that the outlines enclose, modules.
fn enclosed(modules: &Modules) -> f64 {
    let twice = |outline: &Vec<[usize; 2]>| -> f64 {
        let next = outline.iter().cycle().skip(1);
        let cross = |([x, y], [u, v]): (&[usize; 2], &[usize; 2])| (x * v) as f64 - (u * y) as f64;
        outline.iter().zip(next).map(cross).sum()
    };
    outlines(modules).iter().map(twice).sum::<f64>() / 2.0
}

fn dark(modules: &Modules) -> f64 {
    let [columns, rows] = modules.size();
    (0..rows)
        .flat_map(|row| (0..columns).map(move |column| (column, row)))
        .filter(|(column, row)| modules.is_dark(*column, *row))
        .count() as f64
}
