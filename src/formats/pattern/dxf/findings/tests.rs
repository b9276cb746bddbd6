use super::super::tests::{drawing, length, line, notice, polyline, section};
use crate::formats::pattern::{PatternOptions, PatternReading, read};
use crate::geometry::pattern::Shape;

/// A drawing with these header variables.
fn with_header(variables: &str, before: &str, entities: &str) -> PatternReading {
    let text = String::from_utf8(drawing(before, entities, "")).unwrap();
    let text = text.replacen("0\nENDSEC\n", &format!("{variables}0\nENDSEC\n"), 1);
    read(text.as_bytes(), &PatternOptions::default()).unwrap()
}

fn skipped(reading: &PatternReading) -> Vec<(&str, bool)> {
    reading.facts.skipped.iter().map(|skipped| (skipped.entity.as_str(), skipped.is_ink)).collect()
}

/// AutoCAD, system variable PDMODE: 0 is a dot, 1 nothing; all others are symbols.
#[test]
fn points_that_are_not_shown_as_dots_are_reported() {
    let point = "0\nPOINT\n5\n2A\n8\n0\n10\n1\n20\n2\n";
    let entities = format!("{}{point}", line(7, false));
    for (variables, is_dot, is_symbol) in [
        ("", true, false),
        ("9\n$PDMODE\n70\n0\n", true, false),
        ("9\n$PDMODE\n70\n1\n", false, false),
        ("9\n$PDMODE\n70\n3\n", true, true),
        ("9\n$PDMODE\n70\n34\n9\n$PDSIZE\n40\n5\n", true, true),
    ] {
        let reading = with_header(variables, "", &entities);
        let dots = reading.pattern.paths.iter().filter(|path| matches!(path.shape, Shape::Dot(_)));
        assert_eq!(dots.count(), usize::from(is_dot), "{variables}");
        assert_eq!(skipped(&reading), if is_dot { vec![] } else { vec![("POINT", false)] }, "{variables}");
        let message = notice(&reading, "point-symbols");
        assert_eq!(message.is_some(), is_symbol, "{variables}");
        assert!(message.is_none_or(|message| message.contains("1 point is") && message.contains("POINT 2A")));
    }
}

/// AutoCAD, system variable FILLMODE.
#[test]
fn fills_that_the_drawing_does_not_show_are_reported() {
    let solid = "0\nSOLID\n8\n0\n10\n0\n20\n0\n11\n5\n21\n0\n12\n0\n22\n5\n13\n5\n23\n5\n";
    for (entities, is_fill) in
        [(solid.to_owned(), true), (polyline(1.0), true), (polyline(0.0), false), (polyline(0.01), false)]
    {
        for (variables, hides) in
            [("", false), ("9\n$FILLMODE\n70\n1\n", false), ("9\n$FILLMODE\n70\n0\n", true)]
        {
            let message = notice(&with_header(variables, "", &entities), "fills-not-shown");
            assert_eq!(message.is_some(), is_fill && hides, "{entities} {variables}");
        }
    }
}

/// AutoCAD, system variable ATTMODE: 0 is none, 1 those that are visible, 2 all.
#[test]
fn the_attributes_that_the_drawing_shows_are_marked() {
    let attribute = |flags: u32| {
        format!(
            "0\nINSERT\n8\n0\n66\n1\n2\nB\n10\n0\n20\n0\n0\nATTRIB\n8\n0\n10\n0\n20\n0\n40\n5\n1\nA\n2\nT\n70\n{flags}\n0\nSEQEND\n8\n0\n"
        )
    };
    let blocks = section("BLOCKS", "0\nBLOCK\n2\nB\n10\n0\n20\n0\n0\nENDBLK\n");
    let text = "0\nTEXT\n8\n0\n10\n0\n20\n20\n40\n5\n1\nA\n";
    for (mode, flags, is_marked) in
        [(0, 0, false), (0, 1, false), (1, 0, true), (1, 1, false), (2, 0, true), (2, 1, true)]
    {
        let reading = with_header(&format!("9\n$ATTMODE\n70\n{mode}\n"), &blocks, &(attribute(flags) + text));
        let of = |kind: &str| reading.pattern.paths.iter().any(|path| path.source.entity == kind);
        assert_eq!((of("ATTRIB"), of("TEXT")), (is_marked, true), "{mode} {flags}");
        assert_eq!(
            skipped(&reading),
            if is_marked { vec![] } else { vec![("ATTRIB", false)] },
            "{mode} {flags}"
        );
    }
}

fn triangle(kind: &str, groups: &str, gradient: &str) -> String {
    match kind {
        "HATCH" => format!(
            "0\nHATCH\n5\n2A\n8\nFILL\n{groups}100\nAcDbHatch\n10\n0\n20\n0\n30\n0\n2\nSOLID\n70\n1\n71\n0\n91\n1\n92\n2\n72\n0\n73\n1\n93\n3\n\
             10\n0\n20\n0\n10\n8\n20\n0\n10\n8\n20\n6\n97\n0\n75\n0\n76\n1\n98\n0\n{gradient}"
        ),
        "SOLID" => format!("0\nSOLID\n5\n2A\n8\nFILL\n{groups}10\n0\n20\n0\n11\n8\n21\n0\n12\n8\n22\n6\n"),
        "LWPOLYLINE" => polyline(1.0).replace("8\nMARK\n", &format!("8\nFILL\n{groups}")),
        _ => line(8, false).replace("8\nMARK\n", &format!("5\n2A\n8\nFILL\n{groups}")),
    }
}

/// A tables section with the layer FILL, with these groups.
fn fill_layer(groups: &str, data: &str) -> String {
    let layer = format!("0\nLAYER\n2\nFILL\n70\n0\n{groups}6\nCONTINUOUS\n{data}");
    section("TABLES", &format!("0\nTABLE\n2\nLAYER\n70\n1\n{layer}0\nENDTAB\n"))
}

/// ezdxf draws these areas in #ffffff on paper; colour 7 is black there.
#[test]
fn white_fills_are_reported() {
    let (true_white, layers) = ("62\n7\n420\n16777215\n", fill_layer("62\n1\n", ""));
    let white_layer = fill_layer("62\n7\n420\n16777215\n", "");
    for (kind, groups, tables, is_white) in [
        ("HATCH", true_white, &layers, true),
        ("SOLID", true_white, &layers, true),
        ("LWPOLYLINE", true_white, &layers, true),
        ("LINE", true_white, &layers, false),
        ("HATCH", "62\n255\n", &layers, true),
        ("HATCH", "62\n7\n", &layers, false),
        ("HATCH", "420\n16711680\n", &layers, false),
        ("HATCH", "", &layers, false),
        ("HATCH", "", &white_layer, true),
        ("HATCH", "62\n256\n", &white_layer, true),
        ("SOLID", "62\n3\n", &white_layer, false),
    ] {
        let file = drawing(tables, &triangle(kind, groups, ""), "");
        let found = |ink: Option<&str>| {
            let ink_layers = ink.map(|name| vec![name.to_owned()]);
            let options = PatternOptions { ink_layers, ..PatternOptions::default() };
            notice(&read(&file, &options).unwrap(), "white-fills")
        };
        let message = found(Some("FILL"));
        assert_eq!(message.is_some(), is_white, "{kind} {groups:?}: {message:?}");
        assert!(message.is_none_or(|message| message.contains("1 filled area is white")));
        assert_eq!((found(None).is_some(), found(Some("OTHER")).is_some()), (is_white, false));
    }
    // The colour of the block, and of the layer of the insert.
    let block = triangle("HATCH", "62\n0\n", "").replace("8\nFILL\n", "8\n0\n");
    let blocks = section("BLOCKS", &format!("0\nBLOCK\n2\nB\n10\n0\n20\n0\n{block}0\nENDBLK\n"));
    for (tables, groups, is_white) in
        [(&layers, true_white, true), (&white_layer, "", true), (&layers, "", false)]
    {
        let insert = format!("0\nINSERT\n8\nFILL\n{groups}2\nB\n10\n0\n20\n0\n");
        let reading = read(&drawing(&format!("{tables}{blocks}"), &insert, ""), &PatternOptions::default());
        assert_eq!(notice(&reading.unwrap(), "white-fills").is_some(), is_white, "{groups:?}");
    }
}

#[test]
fn hatches_with_a_gradient_are_reported() {
    let gradient =
        |kind: u32| format!("450\n{kind}\n451\n0\n460\n0\n461\n0\n452\n0\n462\n0\n453\n0\n470\nLINEAR\n");
    for (groups, is_gradient) in [(String::new(), false), (gradient(0), false), (gradient(1), true)] {
        let hatch = triangle("HATCH", "", &groups);
        let reading = read(&drawing("", &hatch, ""), &PatternOptions::default()).unwrap();
        assert!((length(&reading) - 24.0).abs() < 1e-9);
        let message = notice(&reading, "gradients-whole");
        assert_eq!(message.is_some(), is_gradient, "{groups}");
        assert!(message.is_none_or(|message| message.contains("1 hatch has a gradient (first: HATCH 2A")));
    }
}

/// ezdxf, `float2transparency`: 0x02000000 and the opacity of 255; 0x01000000 is that of the block.
#[test]
fn partly_transparent_entities_are_reported() {
    let half = 0x0200_0080;
    let (opaque, thin) = (
        fill_layer("62\n1\n", ""),
        fill_layer("62\n1\n", &format!("1001\nOTHER\n1071\n{half}\n1001\nAcCmTransparency\n1071\n{half}\n")),
    );
    let of_other = fill_layer("62\n1\n", &format!("1001\nOTHER\n1071\n{half}\n"));
    for (number, tables, is_thin) in [
        (None, &opaque, false),
        (Some(half), &opaque, true),
        (Some(0x0200_00ff), &opaque, false),
        (Some(0), &opaque, false),
        (None, &thin, true),
        (Some(0), &thin, true),
        (Some(0x0200_00ff), &thin, false),
        (Some(0x0100_0000), &thin, false),
        (None, &of_other, false),
    ] {
        let groups = number.map_or_else(String::new, |number| format!("440\n{number}\n"));
        for kind in ["HATCH", "SOLID", "LWPOLYLINE", "LINE"] {
            let file = drawing(tables, &triangle(kind, &groups, ""), "");
            let found = notice(&read(&file, &PatternOptions::default()).unwrap(), "transparent-whole");
            assert_eq!(found.is_some(), is_thin, "{kind} {number:?}");
        }
    }
    let block = triangle("SOLID", &format!("440\n{}\n", 0x0100_0000), "");
    let blocks = section("BLOCKS", &format!("0\nBLOCK\n2\nB\n10\n0\n20\n0\n{block}0\nENDBLK\n"));
    for (groups, is_thin) in [(String::new(), false), (format!("440\n{half}\n"), true)] {
        let insert = format!("0\nINSERT\n8\n0\n{groups}2\nB\n10\n0\n20\n0\n");
        let reading = read(&drawing(&blocks, &insert, ""), &PatternOptions::default()).unwrap();
        assert_eq!(notice(&reading, "transparent-whole").is_some(), is_thin);
    }
}
