use crate::formats::pattern::{PatternOptions, PatternReadError, PatternReading, Space, Strokes, read};
use crate::geometry::pattern::Shape;
use crate::geometry::space::FlatPoint;

pub(super) fn section(name: &str, content: &str) -> String {
    format!("0\nSECTION\n2\n{name}\n{content}0\nENDSEC\n")
}

/// A drawing in mm with these entities, and other sections before and after them.
pub(super) fn drawing(before: &str, entities: &str, after: &str) -> Vec<u8> {
    let header = section("HEADER", "9\n$ACADVER\n1\nAC1015\n9\n$INSUNITS\n70\n4\n");
    format!("{header}{before}{}{after}0\nEOF\n", section("ENTITIES", entities)).into_bytes()
}

pub(super) fn line(length: u32, in_paper_space: bool) -> String {
    let paper = if in_paper_space { "67\n1\n" } else { "" };
    format!("0\nLINE\n8\nMARK\n{paper}10\n0\n20\n0\n11\n{length}\n21\n0\n")
}

pub(super) fn polyline(width: f64) -> String {
    format!(
        "0\nLWPOLYLINE\n5\n2A\n8\nMARK\n90\n3\n70\n0\n43\n{width}\n10\n0\n20\n0\n10\n10\n20\n0\n10\n10\n20\n5\n"
    )
}

pub(super) fn length(reading: &PatternReading) -> f64 {
    reading
        .pattern
        .paths
        .iter()
        .flat_map(|path| path.shape.segments())
        .map(|segment| segment.start().distance(segment.end()))
        .sum()
}

pub(super) fn notice(reading: &PatternReading, code: &str) -> Option<String> {
    reading.facts.notices.iter().find(|notice| notice.code == code).map(|notice| notice.message.clone())
}

#[test]
fn polylines_narrower_than_the_beam_are_marked_once_along_their_centre() {
    let options = PatternOptions::default();
    let narrow = read(&drawing("", &polyline(0.003), ""), &options).unwrap();
    assert!(matches!(narrow.pattern.paths[..], [ref path] if matches!(path.shape, Shape::Open(_))));
    assert!((length(&narrow) - 15.0).abs() < 1e-12);
    let message = notice(&narrow, "hairlines-centred").unwrap();
    assert!(
        message.contains("1 line is narrower than 0.05 mm") && message.contains("LWPOLYLINE 2A"),
        "{message}"
    );
    assert!(notice(&narrow, "wide-lines").is_none());
    // A line of the beam's width, one that the settings allow, a wide one, one below a larger limit, one without a width.
    for (width, hairline, sides) in
        [(0.05, 0.05, 2.0), (0.003, 0.0, 2.0), (0.2, 0.05, 2.0), (0.2, 0.3, 1.0), (0.0, 0.05, 1.0)]
    {
        let reading =
            read(&drawing("", &polyline(width), ""), &options.clone().with_hairline(hairline)).unwrap();
        assert!((length(&reading) - sides * 15.0).abs() < 1.0, "{width}, {hairline}: {}", length(&reading));
        assert_eq!(notice(&reading, "wide-lines").is_some(), sides == 2.0, "{width}, {hairline}");
    }
}

#[test]
fn line_weights_much_wider_than_a_laser_line_are_reported_once() {
    let layer = |name: &str, weight: i32| {
        format!("0\nLAYER\n2\n{name}\n70\n0\n62\n7\n6\nCONTINUOUS\n370\n{weight}\n")
    };
    let layers = [layer("THICK", 50), layer("THIN", 35), layer("USUAL", -3)].concat();
    let tables = section("TABLES", &format!("0\nTABLE\n2\nLAYER\n70\n3\n{layers}0\nENDTAB\n"));
    let line = |handle: &str, layer: &str, weight: Option<i32>, y: i32| {
        let weight = weight.map_or_else(String::new, |weight| format!("370\n{weight}\n"));
        format!("0\nLINE\n5\n{handle}\n8\n{layer}\n{weight}10\n0\n20\n{y}\n11\n9\n21\n{y}\n")
    };
    let found = |lines: &[String]| {
        let reading = read(&drawing(&tables, &lines.concat(), ""), &PatternOptions::default()).unwrap();
        notice(&reading, "line-weight-unused")
    };
    // By layer without a code and with it, own, by block, default.
    for (layer, weight, is_wide) in [
        ("THICK", None, true),
        ("THICK", Some(-1), true),
        ("THICK", Some(25), false),
        ("THICK", Some(-2), false),
        ("THICK", Some(-3), false),
        ("THIN", None, false),
        ("THIN", Some(40), true),
        ("USUAL", None, false),
        ("NOT IN THE TABLE", None, false),
        ("NOT IN THE TABLE", Some(211), true),
    ] {
        assert_eq!(found(&[line("2A", layer, weight, 0)]).is_some(), is_wide, "{layer}, {weight:?}");
    }
    let all = [line("2A", "THIN", None, 0), line("2B", "THICK", None, 1), line("2C", "THIN", Some(70), 2)];
    let message = found(&all).unwrap();
    assert!(message.starts_with("2 lines have a line weight of up to 0.70 mm"), "{message}");
    assert!(message.contains("first: LINE 2B on layer THICK"), "{message}");
    // Lines of layers that are not marked do not count.
    for (ink, expected) in [("thick", Some("1 line has a line weight of up to 0.50 mm")), ("USUAL", None)] {
        let options = PatternOptions { ink_layers: Some(vec![ink.into()]), ..PatternOptions::default() };
        let reading = read(&drawing(&tables, &all.concat(), ""), &options).unwrap();
        let message = notice(&reading, "line-weight-unused");
        assert_eq!(message.as_deref().map(|message| message.split(';').next().unwrap()), expected, "{ink}");
    }
}

#[test]
fn the_width_on_the_part_decides_where_a_block_is_scaled() {
    let content = polyline(0.4);
    let block = section("BLOCKS", &format!("0\nBLOCK\n2\nLOGO\n10\n0\n20\n0\n{content}0\nENDBLK\n"));
    let insert =
        |scale: f64| format!("0\nINSERT\n8\nMARK\n2\nLOGO\n10\n0\n20\n0\n41\n{scale}\n42\n{scale}\n");
    let both = drawing(&block, &(insert(0.1) + &insert(2.0)), "");
    let reading = read(&both, &PatternOptions::default()).unwrap();
    let open = reading.pattern.paths.iter().filter(|path| matches!(path.shape, Shape::Open(_)));
    assert_eq!((open.count(), reading.pattern.paths.len()), (1, 2));
    assert!(notice(&reading, "hairlines-centred").unwrap().contains("1 line is"));
    // In metres, the same number is the width of a wide line.
    let metres = String::from_utf8(drawing("", &polyline(0.003), "")).unwrap();
    let metres = metres.replace("70\n4\n0\nENDSEC", "70\n6\n0\nENDSEC");
    let reading = read(metres.as_bytes(), &PatternOptions::default()).unwrap();
    assert!(notice(&reading, "hairlines-centred").is_none() && reading.pattern.paths[0].region.is_some());
}

#[test]
fn narrow_strokes_of_an_svg_are_centre_lines_also_as_bands() {
    let svg = |width: f64| {
        format!(
            "<svg xmlns='http://www.w3.org/2000/svg' width='20mm' height='20mm' viewBox='0 0 20 20'>\
             <path d='M1 1H11V6' fill='none' stroke='black' stroke-width='{width}'/></svg>"
        )
    };
    let bands = PatternOptions::default().with_strokes(Strokes::Band);
    let narrow = read(svg(0.01).as_bytes(), &bands).unwrap();
    assert!((length(&narrow) - 15.0).abs() < 1e-9 && notice(&narrow, "hairlines-centred").is_some());
    let wide = read(svg(1.0).as_bytes(), &bands).unwrap();
    assert!(length(&wide) > 30.0 && notice(&wide, "hairlines-centred").is_none());
    assert!(length(&read(svg(0.01).as_bytes(), &bands.with_hairline(0.0)).unwrap()) > 29.0);
}

/// Tables and blocks, and objects, of the active sheet, which is named Front, and of two others, named Back and Lid.
fn sheets(back: &str, lid: &str) -> (String, String) {
    let record = |handle: &str, name: &str| format!("0\nBLOCK_RECORD\n5\n{handle}\n2\n{name}\n");
    let records =
        record("1F", "*Paper_Space") + &record("2f", "*Paper_Space0") + &record("3F", "*Paper_Space1");
    let tables = section("TABLES", &format!("0\nTABLE\n2\nBLOCK_RECORD\n70\n3\n{records}0\nENDTAB\n"));
    let block =
        |name: &str, content: &str| format!("0\nBLOCK\n2\n{name}\n10\n0\n20\n0\n{content}0\nENDBLK\n");
    let content = block("*Paper_Space", "") + &block("*Paper_Space0", back) + &block("*Paper_Space1", lid);
    let layout = |record: &str, name: &str| {
        format!(
            "0\nLAYOUT\n5\nA1\n330\n1A\n100\nAcDbPlotSettings\n1\nplot\n100\nAcDbLayout\n1\n{name}\n330\n{record}\n"
        )
    };
    let objects = section("OBJECTS", &(layout("1F", "Front") + &layout("2F", "Back") + &layout("3f", "Lid")));
    (tables + &section("BLOCKS", &content), objects)
}

fn paper(sheet: Option<&str>) -> PatternOptions {
    PatternOptions::default().with_space(Space::Paper(sheet.map(str::to_owned)))
}

#[test]
fn the_sheet_of_a_drawing_in_paper_space_is_read() {
    let viewport = "0\nVIEWPORT\n8\n0\n67\n1\n";
    let (before, after) = sheets("", viewport);
    let entities = line(7, false) + &line(20, true) + viewport;
    let bytes = drawing(&before, &entities, &after);
    let model = read(&bytes, &PatternOptions::default()).unwrap();
    assert_eq!((length(&model), model.facts.skipped.len()), (7.0, 3));
    let sheet = read(&bytes, &paper(None)).unwrap();
    assert_eq!(length(&sheet), 20.0);
    let left = &sheet.facts.skipped[0];
    assert!(left.entity == "LINE" && left.why.contains("in model space") && !left.is_ink, "{left:?}");
    // Files of R12 have neither blocks nor names of sheets.
    assert_eq!(length(&read(&drawing("", &entities, ""), &paper(None)).unwrap()), 20.0);
}

#[test]
fn a_sheet_that_is_plotted_in_another_unit_is_reported_with_both_sizes() {
    let viewport = "0\nVIEWPORT\n8\n0\n67\n1\n";
    let (before, after) = sheets("", viewport);
    let plotted = |unit: &str| {
        let objects = after.replace("AcDbPlotSettings\n", &format!("AcDbPlotSettings\n72\n{unit}\n"));
        read(&drawing(&before, &line(20, true), &objects), &paper(None)).unwrap()
    };
    // The drawing is in millimetres.
    assert!(notice(&plotted("1"), "sheet-unit").is_none() && notice(&plotted("2"), "sheet-unit").is_none());
    let words = notice(&plotted("0"), "sheet-unit").unwrap().to_owned();
    assert!(words.contains("508.000 x 0.000 mm, not 20.000 x 0.000 mm"), "{words}");
}

#[test]
fn several_sheets_are_chosen_by_name_or_listed() {
    let (before, after) = sheets(&line(30, true), &line(40, false));
    let bytes = drawing(&before, &(line(7, false) + &line(20, true)), &after);
    for (name, expected) in [("Front", 20.0), ("back", 30.0), ("LID", 40.0)] {
        let reading = read(&bytes, &paper(Some(name))).unwrap();
        assert_eq!(length(&reading), expected, "{name}");
        assert_eq!(reading.facts.skipped.len(), 3, "{name}: {:?}", reading.facts.skipped);
    }
    let refused = read(&bytes, &paper(None)).unwrap_err();
    let names = ["Front", "Back", "Lid"].map(str::to_owned).to_vec();
    assert_eq!(refused, PatternReadError::UnclearSheet { asked: None, sheets: names });
    let reason = read(&bytes, &paper(Some("Side"))).unwrap_err().reason();
    assert!(reason.code == "sheet-unclear" && reason.what.contains("\"Side\""), "{reason:?}");
    assert!(reason.what.contains("\"Lid\"") && reason.remedy.contains("paper:Front"), "{reason:?}");
    let none = read(&drawing("", &line(7, false), ""), &paper(None)).unwrap_err();
    assert_eq!(none, PatternReadError::UnclearSheet { asked: None, sheets: Vec::new() });
}

#[test]
fn a_drawing_with_sheets_only_suggests_to_read_them() {
    let refused = read(&drawing("", &line(20, true), ""), &PatternOptions::default()).unwrap_err().reason();
    assert!(refused.remedy.contains("--space paper"), "{refused:?}");
    for (word, space) in [
        ("model", Some(Space::Model)),
        ("paper", Some(Space::Paper(None))),
        ("paper: Sheet A ", Some(Space::Paper(Some("Sheet A".into())))),
        ("paper:", None),
        ("attic", None),
        ("model:1", None),
    ] {
        assert_eq!(word.parse().ok(), space, "{word}");
    }
}

/// The heights of round curves in tilted planes are their extrema, not those of their ends.
#[test]
fn curves_that_leave_the_plane_between_their_ends_are_not_flat() {
    let tilted = "210\n0\n220\n0.6\n230\n0.8\n";
    let circle = "8\n0\n10\n0\n20\n0\n40\n20\n";
    let block = format!(
        "0\nBLOCK\n2\nB\n10\n0\n20\n0\n30\n0\n0\nCIRCLE\n{circle}0\nENDBLK\n0\nBLOCK\n2\nC\n10\n0\n20\n0\n0\nENDBLK\n"
    );
    let edge = "0\nHATCH\n8\n0\n10\n0\n20\n0\n30\n0\n2\nSOLID\n70\n1\n71\n0\n91\n1\n92\n1\n93\n1\n72\n2\n10\n0\n20\n0\n40\n20\n50\n0\n51\n360\n73\n1\n97\n0\n75\n0\n76\n1\n98\n0\n";
    let spline = "0\nSPLINE\n8\n0\n70\n8\n71\n3\n72\n8\n73\n4\n40\n0\n40\n0\n40\n0\n40\n0\n40\n1\n40\n1\n40\n1\n40\n1\n\
                  10\n0\n20\n0\n30\n0\n10\n5\n20\n0\n30\n4\n10\n9\n20\n0\n30\n-4\n10\n14\n20\n0\n30\n0\n";
    // A point at the angle t of a circle of radius 20 whose plane is tilted so is 20 · 0.6 · sin(t + turn) high.
    let arc = |from: u32, to: u32| format!("0\nARC\n{circle}50\n{from}\n51\n{to}\n{tilted}");
    let bulged = "0\nLWPOLYLINE\n8\n0\n90\n2\n70\n0\n10\n-20\n20\n0\n42\n-1\n10\n20\n20\n0\n";
    let cases = [
        (format!("0\nCIRCLE\n{circle}{tilted}"), 24.0),
        (arc(30, 390), 24.0),
        (arc(0, 90), 12.0),
        (arc(45, 135), 12.0 * (1.0 - 0.5f64.sqrt())),
        (
            "0\nELLIPSE\n8\n0\n10\n0\n20\n0\n11\n16\n21\n0\n31\n12\n40\n0.5\n41\n0\n42\n6.283185307179586\n"
                .into(),
            24.0,
        ),
        (format!("{edge}{tilted}").replace("2\nSOLID", &format!("{tilted}2\nSOLID")), 24.0),
        (format!("0\nINSERT\n8\n0\n2\nB\n10\n0\n20\n0\n{tilted}"), 24.0),
        (format!("{bulged}{tilted}"), 12.0),
        // 12 t (1 - t) (1 - 2t), which is 0 at both ends and in the middle.
        (spline.into(), 4.0 / 3f64.sqrt()),
    ];
    let blocks = section("BLOCKS", &block);
    for (entity, range) in cases {
        let reading = read(&drawing(&blocks, &entity, ""), &PatternOptions::default()).unwrap();
        let message = notice(&reading, "not-flat").unwrap_or_else(|| panic!("{entity}"));
        let numbers: Vec<f64> = message.split([' ', '=']).filter_map(|word| word.parse().ok()).collect();
        assert!((numbers[1] - numbers[0] - range).abs() < 2e-3, "{entity}: {message}");
    }
    let flat =
        [format!("0\nCIRCLE\n{circle}30\n5\n"), format!("0\nCIRCLE\n{circle}210\n0\n220\n0\n230\n-1\n")];
    for entity in flat {
        let reading = read(&drawing("", &entity, ""), &PatternOptions::default()).unwrap();
        assert_eq!(notice(&reading, "not-flat"), None, "{entity}");
    }
}

/// A text 5 high with its lower left corner at (10, 5) and a background that reaches `(factor - 1) * 5` beyond it.
fn text_with_background(fill: u32, factor: f64) -> String {
    format!(
        "0\nMTEXT\n5\n30\n8\nMARK\n10\n10\n20\n10\n40\n5\n71\n1\n1\nHHH\n45\n{factor}\n90\n{fill}\n63\n1\n"
    )
}

fn line_at(y: f64, layer: &str) -> String {
    format!("0\nLINE\n5\n2F\n8\n{layer}\n10\n0\n20\n{y}\n11\n60\n21\n{y}\n")
}

#[test]
fn frames_of_texts_are_drawn_where_their_backgrounds_end() {
    let corners = |fill: u32| {
        let text = text_with_background(fill, 1.5);
        let reading = read(&drawing("", &text, ""), &PatternOptions::default()).unwrap();
        let frames = reading.pattern.paths.iter().filter(|path| path.region.is_none());
        let ends = frames.map(|path| path.shape.segments().iter().map(|part| part.start()).collect());
        ends.collect::<Vec<Vec<FlatPoint>>>()
    };
    assert!(corners(0).iter().chain(&corners(1)).all(|ends| ends.len() != 4));
    for fill in [16, 17] {
        let frames: Vec<_> = corners(fill).into_iter().filter(|ends| ends.len() == 4).collect();
        let [frame] = &frames[..] else { panic!("{frames:?}") };
        // Half a letter beyond the letters, which are 5 high with the upper left corner at (10, 10).
        let near = |at: FlatPoint, x: f64, y: f64| (at.x - x).abs() < 1e-9 && (at.y - y).abs() < 1e-9;
        assert!(near(frame[0], 7.5, 2.5) && near(frame[3], 7.5, 12.5), "{frame:?}");
        // Three letters are wider than they are high.
        assert!(near(frame[1], frame[2].x, 2.5) && (17.5..35.0).contains(&frame[1].x), "{frame:?}");
    }
}

/// Like a WIPEOUT, a background would show lines that the drawing does not show.
#[test]
fn backgrounds_of_texts_are_lost_only_where_they_hide_ink() {
    let text = text_with_background(3, 1.5);
    let square = "0\nHATCH\n8\n0\n10\n0\n20\n0\n30\n0\n2\nSOLID\n70\n1\n71\n0\n91\n1\n92\n2\n72\n0\n73\n1\n93\n4\n10\n-50\n20\n-50\n10\n90\n\
                  20\n-50\n10\n90\n20\n90\n10\n-50\n20\n90\n97\n0\n75\n0\n76\n1\n98\n0\n";
    let frame = "0\nLWPOLYLINE\n8\n0\n90\n4\n70\n1\n10\n-50\n20\n-50\n10\n90\n20\n-50\n10\n90\n20\n90\n10\n-50\n20\n90\n";
    let order = section("OBJECTS", "0\nSORTENTSTABLE\n5\n40\n330\n17\n331\n30\n5\n60\n");
    let behind = |line: String| format!("{line}{text}");
    let cases = [
        (behind(line_at(7.5, "MARK")), "", true),
        (behind(line_at(11.5, "MARK")), "", true),
        // Beside the background, on it, or on a layer that is not marked.
        (behind(line_at(13.0, "MARK")), "", false),
        (behind(line_at(2.0, "MARK")), "", false),
        (format!("{text}{}", line_at(7.5, "MARK")), "", false),
        (behind(line_at(7.5, "NOTES")), "", false),
        // In another order than that of the file, it may be behind.
        (format!("{text}{}", line_at(7.5, "MARK")), &order, true),
        (text.clone(), &order, false),
        (behind(square.into()), "", true),
        (behind(frame.into()), "", false),
        (format!("{}{}", line_at(7.5, "MARK"), text_with_background(0, 1.5)), "", false),
        (format!("{}{}", line_at(11.5, "MARK"), text_with_background(1, 1.1)), "", false),
        (format!("{}{}", line_at(7.5, "MARK"), text_with_background(1, 1.1)), "", true),
    ];
    let options =
        PatternOptions { ink_layers: Some(vec!["MARK".into(), "0".into()]), ..PatternOptions::default() };
    for (number, (entities, objects, is_lost)) in cases.into_iter().enumerate() {
        let reading = read(&drawing("", &entities, objects), &options).unwrap();
        let lost: Vec<&str> = reading
            .facts
            .skipped
            .iter()
            .filter(|skipped| skipped.is_ink)
            .map(|s| s.entity.as_str())
            .collect();
        assert_eq!(lost, if is_lost { vec!["MTEXT"] } else { Vec::new() }, "{number}");
        // The letters are drawn all the same.
        assert!(reading.pattern.paths.iter().any(|path| path.source.entity == "MTEXT"), "{number}");
    }
    // In a block that is drawn twice, it is one text.
    let block = format!("0\nBLOCK\n2\nB\n10\n0\n20\n0\n30\n0\n{}0\nENDBLK\n", behind(line_at(7.5, "MARK")));
    let insert = |y: u32| format!("0\nINSERT\n8\nMARK\n2\nB\n10\n0\n20\n{y}\n50\n30\n");
    let reading =
        read(&drawing(&section("BLOCKS", &block), &(insert(0) + &insert(50)), ""), &options).unwrap();
    assert_eq!(reading.facts.skipped.len(), 1, "{:?}", reading.facts.skipped);
}

/// An entity may have a picture of itself in front of its own data, with its size as 92.
#[test]
fn the_preview_of_a_hatch_is_no_boundary() {
    let hatch = |preview: &str, kind: &str, class: &str| {
        format!(
            "0\n{kind}\n5\n2A\n100\nAcDbEntity\n8\nMARK\n{preview}100\n{class}\n10\n0\n20\n0\n30\n0\n210\n0\n220\n0\n230\n-1\n2\nSOLID\n70\n1\n71\n0\n91\n1\n\
             92\n2\n72\n0\n73\n1\n93\n3\n10\n0\n20\n0\n10\n8\n20\n0\n10\n8\n20\n6\n97\n0\n75\n0\n76\n1\n98\n0\n"
        )
    };
    for (kind, class) in [("HATCH", "AcDbHatch"), ("MPOLYGON", "AcDbMPolygon")] {
        for preview in ["", "92\n3\n310\nC0FFEE\n", "92\n4\n310\nC0FFEE00\n", "160\n3\n310\nC0FFEE\n"] {
            let reading =
                read(&drawing("", &hatch(preview, kind, class), ""), &PatternOptions::default()).unwrap();
            assert!(reading.facts.skipped.is_empty(), "{kind} {preview:?}: {:?}", reading.facts.skipped);
            // Seen from below, x is mirrored.
            assert_eq!(reading.facts.extents, [-8.0, 0.0, 0.0, 6.0], "{kind} {preview:?}");
        }
    }
}

/// A tables section with the layers SOLID and DASHED, whose lines are 0.5 mm wide.
fn dashed_layers() -> String {
    let layer = |name: &str, line_type: &str, weight: i32| {
        format!("0\nLAYER\n2\n{name}\n70\n0\n62\n7\n6\n{line_type}\n370\n{weight}\n")
    };
    let layers = layer("SOLID", "CONTINUOUS", -3) + &layer("DASHED", "HIDDEN", 50);
    section("TABLES", &format!("0\nTABLE\n2\nLAYER\n70\n2\n{layers}0\nENDTAB\n"))
}

/// AutoCAD shows the gaps of a wide line, too.
#[test]
fn dashed_lines_with_a_width_are_reported() {
    let old = |width: f64, groups: &str| {
        let vertex = |x: u32| format!("0\nVERTEX\n8\nSOLID\n10\n{x}\n20\n0\n");
        format!(
            "0\nPOLYLINE\n8\nSOLID\n{groups}66\n1\n40\n{width}\n41\n{width}\n70\n0\n{}{}0\nSEQEND\n",
            vertex(0),
            vertex(50)
        )
    };
    let light =
        |width: f64, groups: &str| polyline(width).replace("8\nMARK\n", &format!("8\nSOLID\n{groups}"));
    for groups in ["", "6\nDASHED\n", "6\nCONTINUOUS\n", "6\nByBlock\n"] {
        for line in [light(1.0, groups), light(0.001, groups), light(0.0, groups), old(1.0, groups)] {
            let reading = read(&drawing(&dashed_layers(), &line, ""), &PatternOptions::default()).unwrap();
            assert_eq!(notice(&reading, "dashed-whole").is_some(), groups == "6\nDASHED\n", "{line}");
        }
    }
}

#[test]
fn lines_have_the_line_type_and_weight_of_their_block() {
    let notices = |line: &str, insert: &str| {
        let block =
            |name: &str, content: &str| format!("0\nBLOCK\n2\n{name}\n10\n0\n20\n0\n{content}0\nENDBLK\n");
        let blocks = block("IN", &format!("0\nLINE\n{line}10\n0\n20\n0\n11\n9\n21\n0\n"))
            + &block("OUT", "0\nINSERT\n8\n0\n6\nBYBLOCK\n370\n-2\n2\nIN\n10\n0\n20\n0\n");
        let before = dashed_layers() + &section("BLOCKS", &blocks);
        ["IN", "OUT"].map(|name| {
            let insert = format!("0\nINSERT\n{insert}2\n{name}\n10\n0\n20\n0\n");
            let reading = read(&drawing(&before, &insert, ""), &PatternOptions::default()).unwrap();
            ["dashed-whole", "line-weight-unused"].map(|code| notice(&reading, code).is_some())
        })
    };
    let by_block = "8\nSOLID\n6\nBYBLOCK\n370\n-2\n";
    for (line, insert, expected) in [
        (by_block, "8\nSOLID\n6\nHIDDEN\n370\n50\n", [true; 2]),
        (by_block, "8\nDASHED\n", [true; 2]),
        (by_block, "8\nSOLID\n", [false; 2]),
        (by_block, "8\nDASHED\n6\nCONTINUOUS\n370\n25\n", [false; 2]),
        (by_block, "8\nSOLID\n6\nBYBLOCK\n370\n-2\n", [false; 2]),
        // On layer 0 in a block, the layer is that of the insert.
        ("8\n0\n", "8\nDASHED\n", [true; 2]),
        ("8\nSOLID\n", "8\nDASHED\n6\nHIDDEN\n370\n50\n", [false; 2]),
        ("8\nSOLID\n6\nHIDDEN\n370\n50\n", "8\nSOLID\n", [true; 2]),
    ] {
        assert_eq!(notices(line, insert), [expected; 2], "{line:?} {insert:?}");
    }
}
