use super::super::tests::{drawing, notice, section};
use crate::formats::pattern::{PatternOptions, PatternReadError, PatternReading, read};
use crate::geometry::pattern::Shape;

/// A drawing with one of these entities, read as a file of this version; a line makes sure that something is marked.
fn read_as(version: &str, entity: &str) -> PatternReading {
    let line = "0\nLINE\n8\n0\n10\n0\n20\n-50\n11\n9\n21\n-50\n";
    let block = section("BLOCKS", "0\nBLOCK\n2\nB\n10\n0\n20\n0\n0\nENDBLK\n");
    let bytes = drawing(&block, &format!("{line}{entity}"), "");
    let text = String::from_utf8(bytes).unwrap().replace("AC1015", version);
    read(text.as_bytes(), &PatternOptions::default()).unwrap()
}

fn shapes(reading: &PatternReading) -> Vec<&Shape> {
    reading.pattern.paths.iter().filter(|path| path.source.entity != "LINE").map(|path| &path.shape).collect()
}

/// An attribute with these groups in the subclass of its text, in its own subclass, and behind them.
fn attribute(kind: &str, of_text: &str, own: &str, behind: &str) -> String {
    let class = if kind == "ATTDEF" { "AcDbAttributeDefinition" } else { "AcDbAttribute" };
    let insert = if kind == "ATTDEF" { "" } else { "0\nINSERT\n8\n0\n66\n1\n2\nB\n10\n0\n20\n0\n" };
    format!("{insert}0\n{kind}\n8\n0\n100\nAcDbText\n{of_text}100\n{class}\n2\nTAG\n{own}{behind}")
}

const GROUPS: &str = "10\n5\n20\n7\n40\n5\n1\nSN 12345\n";
/// What files of R2018 add: the type of the attribute, an unknown number, and the second point again.
const OF_R2018: &str = "71\n1\n72\n0\n11\n50\n21\n20\n";

/// An attribute is drawn as a TEXT with the same groups, whose vertical alignment is 73 instead of 74.
#[test]
fn an_attribute_is_aligned_by_the_groups_of_its_text_in_every_version() {
    let second = "11\n50\n21\n20\n";
    for (aligned, vertical) in [
        ("72\n1\n", 0),
        ("72\n2\n", 2),
        ("72\n4\n", 0),
        ("72\n5\n", 0),
        ("72\n3\n", 0),
        ("72\n0\n", 3),
        ("72\n1\n71\n2\n", 0),
        ("72\n2\n71\n4\n50\n30\n", 1),
    ] {
        let of_text = format!("{GROUPS}{aligned}{second}");
        let text = format!("0\nTEXT\n8\n0\n100\nAcDbText\n{of_text}100\nAcDbText\n73\n{vertical}\n");
        let as_text = read_as("AC1015", &text);
        assert!(!shapes(&as_text).is_empty());
        for (kind, flags) in [("ATTRIB", 0), ("ATTDEF", 2)] {
            // 73 is the length of the field.
            let own = format!("70\n{flags}\n73\n2\n74\n{vertical}\n");
            for (version, more) in [("AC1015", ""), ("AC1027", ""), ("AC1032", OF_R2018)] {
                let reading = read_as(version, &attribute(kind, &of_text, &own, more));
                assert_eq!(shapes(&reading), shapes(&as_text), "{kind} {version} {aligned:?}");
            }
        }
    }
}

/// The DXF Reference lists these groups of an ATTRIB in its own subclass.
#[test]
fn groups_of_a_text_are_also_read_from_the_subclass_of_the_attribute() {
    let more = "50\n15\n41\n0.7\n51\n10\n71\n2\n72\n1\n11\n50\n21\n20\n";
    let text = read_as("AC1015", &format!("0\nTEXT\n8\n0\n100\nAcDbText\n{GROUPS}{more}"));
    let own = format!("70\n0\n{more}");
    assert_eq!(shapes(&read_as("AC1015", &attribute("ATTRIB", GROUPS, &own, ""))), shapes(&text));
    let without_classes = attribute("ATTRIB", GROUPS, &own, "")
        .replace("100\nAcDbText\n", "")
        .replace("100\nAcDbAttribute\n", "");
    assert_eq!(shapes(&read_as("AC1009", &without_classes)), shapes(&text));
}

#[test]
fn data_behind_an_attribute_does_not_change_its_text() {
    let xrecord = "100\nAcDbXrecord\n280\n1\n70\n0\n70\n1\n70\n0\n10\n99\n20\n88\n30\n0\n40\n0.1\n2\nTAG\n";
    let plain = read_as("AC1032", &attribute("ATTRIB", GROUPS, "70\n0\n71\n1\n72\n0\n", ""));
    let reading = read_as("AC1032", &attribute("ATTRIB", GROUPS, "70\n0\n71\n1\n72\n0\n", xrecord));
    assert!(!shapes(&plain).is_empty());
    assert_eq!(shapes(&reading), shapes(&plain));
}

/// ezdxf and AutoCAD show the MTEXT that is embedded in the attribute, and not its first line.
#[test]
fn an_attribute_with_several_lines_is_drawn_as_its_embedded_mtext() {
    let paragraphs = "10\n5\n20\n7\n40\n4\n41\n0\n46\n0\n71\n2\n72\n5\n3\nLINE1\\PLI\n1\nNE2\\PLINE3\n7\nStandard\n50\n20\n73\n1\n44\n1\n";
    let embedded = format!("101\nEmbedded Object\n{paragraphs}");
    let text = read_as("AC1032", &format!("0\nMTEXT\n8\n0\n100\nAcDbMText\n{paragraphs}"));
    let count = shapes(&text).len();
    let one = read_as("AC1032", "0\nMTEXT\n8\n0\n100\nAcDbMText\n10\n0\n20\n0\n40\n4\n1\nLINE1\n");
    // Three lines of five letters.
    assert!(count >= 15 && count >= 3 * shapes(&one).len(), "{count}");
    for (kind, flags, number) in
        [("ATTRIB", 0, 2), ("ATTDEF", 2, 4), ("ATTRIB", 1, 2), ("ATTDEF", 0, 4), ("ATTDEF", 3, 4)]
    {
        let own = format!("70\n{flags}\n74\n3\n71\n{number}\n72\n0\n");
        let first = "10\n5\n20\n7\n40\n4\n1\nLINE1\n72\n1\n11\n5\n21\n7\n";
        let reading = read_as("AC1032", &attribute(kind, first, &own, &embedded));
        let is_shown = matches!((kind, flags), ("ATTRIB", 0) | ("ATTDEF", 2));
        let expected = if is_shown { shapes(&text) } else { Vec::new() };
        assert_eq!(shapes(&reading), expected, "{kind} {flags}");
        assert_eq!(reading.facts.skipped.is_empty(), is_shown, "{kind} {flags}");
    }
}

/// As ezdxf's `Insert.multi_insert`: a quarter turn makes rows of columns.
#[test]
fn attributes_of_a_block_in_rows_and_columns_are_at_every_copy() {
    let letter = "10\n5\n20\n7\n40\n5\n1\nI\n";
    let array = "70\n3\n71\n2\n44\n30\n45\n20\n50\n90\n";
    let grid = |flags: u32| {
        let attribute = attribute("ATTRIB", letter, &format!("70\n{flags}\n"), "0\nSEQEND\n8\n0\n");
        attribute.replace("66\n1\n", &format!("66\n1\n{array}"))
    };
    let starts = |reading: &PatternReading| {
        let mut starts: Vec<[i64; 2]> = shapes(reading)
            .iter()
            .map(|shape| {
                let start = shape.segments()[0].start();
                [start.x, start.y].map(|number| (number * 1e6).round() as i64)
            })
            .collect();
        starts.sort_unstable();
        starts
    };
    let single = starts(&read_as("AC1015", &attribute("ATTRIB", letter, "70\n0\n", "")));
    let &[[x, y]] = &single[..] else { panic!("{single:?}") };
    let at = |scale: i64| {
        let mut copies: Vec<[i64; 2]> =
            [0, -20].iter().flat_map(|dx| [0, 30, 60].map(|dy| [*dx, dy])).collect();
        copies
            .iter_mut()
            .for_each(|at| *at = [x + at[0] * 1_000_000, y + at[1] * 1_000_000].map(|place| place * scale));
        copies.sort_unstable();
        copies
    };
    let reading = read_as("AC1015", &grid(0));
    assert_eq!(starts(&reading), at(1));
    // In a block that is scaled, too.
    let block = format!("0\nBLOCK\n2\nOUTER\n10\n0\n20\n0\n{}0\nENDBLK\n", grid(0));
    let empty = "0\nBLOCK\n2\nB\n10\n0\n20\n0\n0\nENDBLK\n";
    let insert = "0\nINSERT\n8\n0\n2\nOUTER\n10\n0\n20\n0\n41\n2\n42\n2\n";
    let bytes = drawing(&section("BLOCKS", &format!("{empty}{block}")), insert, "");
    assert_eq!(starts(&read(&bytes, &PatternOptions::default()).unwrap()), at(2));
    // What is not drawn is listed once.
    let hidden = read_as("AC1015", &grid(1));
    assert_eq!((shapes(&hidden).len(), hidden.facts.skipped.len()), (0, 1));
}

#[test]
fn too_many_copies_of_an_attribute_are_refused() {
    let letters = "10\n5\n20\n7\n40\n5\n1\nSERIAL NUMBER\n";
    let attribute = attribute("ATTRIB", letters, "70\n0\n", "0\nSEQEND\n8\n0\n");
    let attribute = attribute.replace("66\n1\n", "66\n1\n70\n990\n71\n990\n44\n9\n45\n9\n");
    let block = section("BLOCKS", "0\nBLOCK\n2\nB\n10\n0\n20\n0\n0\nENDBLK\n");
    let error = read(&drawing(&block, &attribute, ""), &PatternOptions::default()).unwrap_err();
    assert!(matches!(error, PatternReadError::TooMany { .. }), "{error:?}");
}

/// A text in this style, with this data of applications.
fn styled(flags: u32, file: &str, data: &str, text: &str) -> PatternReading {
    let style =
        format!("0\nSTYLE\n2\nOWN\n70\n{flags}\n40\n0\n41\n1\n50\n0\n71\n0\n42\n5\n3\n{file}\n4\n\n{data}");
    let tables = section("TABLES", &format!("0\nTABLE\n2\nSTYLE\n70\n1\n{style}0\nENDTAB\n"));
    let line = "0\nLINE\n8\n0\n10\n0\n20\n-50\n11\n9\n21\n-50\n";
    read(&drawing(&tables, &format!("{line}{text}"), ""), &PatternOptions::default()).unwrap()
}

/// DXF Reference, STYLE: the family of a TrueType font is in the data of the application ACAD.
#[test]
fn only_the_data_of_autocad_names_the_font_of_a_style() {
    let text = "0\nTEXT\n8\n0\n10\n5\n20\n7\n40\n5\n7\nOWN\n1\nAB\n";
    let annotative = "1001\nAcadAnnotative\n1000\nAnnotativeData\n1002\n{\n1070\n1\n1070\n1\n1002\n}\n";
    let font = "1001\nACAD\n1000\nDejaVu Sans\n1071\n34\n";
    for (file, data, is_stroke, name) in [
        ("romans.shx", annotative.to_owned(), true, Some("the font romans.shx")),
        ("arial.ttf", annotative.to_owned(), false, Some("the font arial.ttf")),
        ("romans.shx", font.to_owned(), false, None),
        ("", format!("{annotative}{font}"), false, None),
        ("", format!("{font}{annotative}"), false, None),
    ] {
        let reading = styled(0, file, &data, text);
        assert_eq!(shapes(&reading).iter().all(|shape| matches!(shape, Shape::Closed(_))), !is_stroke);
        let message = notice(&reading, "font-replaced");
        assert_eq!(message.is_some(), name.is_some(), "{file} {data}: {message:?}");
        assert!(message.unwrap_or_default().contains(name.unwrap_or_default()), "{file} {data}");
    }
}

/// Like vertical texts of an SVG, they would have another extent and other places of the letters.
#[test]
fn vertical_texts_are_skipped_with_the_reason() {
    let text = "0\nTEXT\n8\n0\n10\n5\n20\n7\n40\n5\n7\nOWN\n1\nAB\n";
    let paragraph = |flow: &str| format!("0\nMTEXT\n8\n0\n10\n5\n20\n7\n40\n5\n71\n1\n{flow}1\nAB\n7\nOWN\n");
    for (flags, text, is_vertical) in [
        (0, text.to_owned(), false),
        (4, text.to_owned(), true),
        (64, text.to_owned(), false),
        (68, text.replace("\nAB\n", "\n \n"), false),
        (0, paragraph("72\n1\n"), false),
        (0, paragraph("72\n3\n"), true),
        (0, paragraph("72\n5\n"), false),
        (4, paragraph("72\n1\n"), false),
        (4, paragraph("72\n5\n"), true),
        (4, paragraph(""), true),
    ] {
        let reading = styled(flags, "txt.shx", "", &text);
        let lost: Vec<&str> =
            reading.facts.skipped.iter().filter(|s| s.is_ink).map(|s| s.why.as_ref()).collect();
        let why = "it is written vertically: convert it to outlines in the drawing program";
        assert_eq!(lost, if is_vertical { vec![why] } else { Vec::new() }, "{flags} {text}");
        assert_eq!(shapes(&reading).is_empty(), is_vertical || text.contains("\n \n"), "{flags} {text}");
        assert_eq!(
            notice(&reading, "font-replaced").is_some(),
            !shapes(&reading).is_empty(),
            "{flags} {text}"
        );
    }
}
