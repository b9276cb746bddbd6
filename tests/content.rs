//! Content that differs from product to product: fields in texts, codes that an independent reader decodes on the part, and
//! lists of products.

#![allow(
    clippy::unwrap_used,
    clippy::panic,
    unreachable_pub,
    missing_docs,
    reason = "helpers of tests may panic"
)]

use std::io::Write;
use std::process::{Command, Stdio};

use isomark::formats::pattern::{PatternOptions, read};
use isomark::geometry::pattern::Pattern;
use serde_json::{Value, json};

#[path = "program/desk.rs"]
#[allow(dead_code, reason = "each test uses only some of these functions")]
mod desk;
mod schemas;

use desk::{Desk, notices, number};

const PLATE: &str = "v -100 -100 5\nv 100 -100 5\nv 100 100 5\nv -100 100 5\nf 1 2 3 4\n";
const AS_DRAWN: &[&str] = &["--part-unit", "mm", "--part-up", "z"];

/// Decodes contours that are filled by the even-odd rule: dark on light, or light on dark.
const READER: &str = r#"
import sys, json
import zxingcpp
from PIL import Image, ImageDraw, ImageChops
job = json.load(sys.stdin)
points = [p for polygon in job['polygons'] for p in polygon]
left, right = min(p[0] for p in points), max(p[0] for p in points)
low, high = min(p[1] for p in points), max(p[1] for p in points)
scale, margin = job['pixels_per_mm'], job['margin_mm']
size = (round((right - left + 2 * margin) * scale), round((high - low + 2 * margin) * scale))
ink = Image.new('1', size, 0)
for polygon in job['polygons']:
    one = Image.new('1', size, 0)
    ImageDraw.Draw(one).polygon([((x - left + margin) * scale, (high + margin - y) * scale) for x, y in polygon], fill=1)
    ink = ImageChops.logical_xor(ink, one)
picture = ink.convert('L')
if not job['is_light']:
    picture = ImageChops.invert(picture)
print(json.dumps([[str(found.format), found.text] for found in zxingcpp.read_barcodes(picture)]))
"#;

/// What an independent reader decodes; `None` if it is not available.
fn decoded(polygons: &[Vec<[f64; 2]>], pixels_per_mm: f64, is_light: bool) -> Option<Vec<String>> {
    let has_reader = Command::new("python3")
        .args(["-c", "import zxingcpp, PIL"])
        .stderr(Stdio::null())
        .status()
        .is_ok_and(|status| status.success());
    if !has_reader {
        assert!(std::env::var("CI").is_err(), "python3 with zxing-cpp and pillow is required in CI");
        eprintln!("SKIPPED: python3 with zxing-cpp and pillow is not installed, no code was decoded");
        return None;
    }
    let job = json!({ "polygons": polygons, "pixels_per_mm": pixels_per_mm, "margin_mm": 4.0, "is_light": is_light });
    let mut reader = Command::new("python3")
        .args(["-c", READER])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    reader.stdin.take().unwrap().write_all(job.to_string().as_bytes()).unwrap();
    let output = reader.wait_with_output().unwrap();
    assert!(output.status.success());
    let found: Vec<[String; 2]> = serde_json::from_slice(&output.stdout).unwrap();
    Some(found.into_iter().map(|[_, text]| text).collect())
}

/// A drawing of entities.
fn dxf(entities: &str) -> String {
    format!(
        "0\nSECTION\n2\nHEADER\n9\n$ACADVER\n1\nAC1015\n9\n$INSUNITS\n70\n4\n0\nENDSEC\n0\nSECTION\n2\nENTITIES\n{entities}\
         0\nENDSEC\n0\nEOF\n"
    )
}

/// A rectangle round the origin, turned.
fn rectangle(layer: &str, [width, height]: [f64; 2], turned_deg: f64) -> String {
    let (sin, cos) = turned_deg.to_radians().sin_cos();
    let corner =
        |x: f64, y: f64| format!("10\n{}\n20\n{}\n", (x * cos - y * sin) * 0.5, (x * sin + y * cos) * 0.5);
    let corners =
        corner(-width, -height) + &corner(width, -height) + &corner(width, height) + &corner(-width, height);
    format!("0\nLWPOLYLINE\n5\n2F\n8\n{layer}\n90\n4\n70\n1\n{corners}")
}

fn text(layer: &str, text: &str) -> String {
    format!("0\nTEXT\n5\n31\n8\n{layer}\n10\n-30\n20\n20\n40\n5\n1\n{text}\n")
}

fn codes(kind: &str, content: &str, more: &str) -> String {
    format!("content.codes=[{{ layer = 'DM', kind = '{kind}', content = '{content}'{more} }}]")
}

fn run(desk: &Desk, inputs: &[&str], options: &[&str]) -> desk::Output {
    desk.isomark(&[&["correct"], inputs, &["--json", "--out", "out.dxf"], options].concat())
}

fn corrected(desk: &Desk, inputs: &[&str], options: &[&str]) -> (Value, Pattern) {
    let output = run(desk, inputs, options);
    assert_eq!(output.code, 0, "{}", output.err);
    let pattern = read(&desk.read("out.dxf"), &PatternOptions::default().strictly(true)).unwrap().pattern;
    (serde_json::from_str(&output.out).unwrap(), pattern)
}

fn polygons(pattern: &Pattern, place: impl Fn([f64; 2]) -> [f64; 2]) -> Vec<Vec<[f64; 2]>> {
    let polygon = |path: &isomark::geometry::pattern::Path| {
        path.shape.flattened(1e-3).into_iter().map(|point| place([point.x, point.y])).collect()
    };
    pattern.paths.iter().map(polygon).collect()
}

/// The same letters written without fields give the same drawing.
#[test]
fn fields_are_replaced_by_the_values_of_the_product() {
    let desk = Desk::new();
    desk.write("plate.obj", PLATE);
    let mtext = |text: &str| format!("0\nMTEXT\n5\n32\n8\nMARK\n10\n-30\n20\n0\n40\n5\n71\n1\n1\n{text}\n");
    // The anchor of both drawings is the same point.
    let options = [
        "--content",
        "serial=417",
        "--content",
        "csv.LOT=A7^%%c",
        "--date",
        "2026-11-23T14:05",
        "--anchor",
        "origin",
    ];
    let shifts = ["--set", "content.shifts=[{name='early',from='06:00'},{name='late',from='14:00'}]"];
    let options = [AS_DRAWN, &options, &shifts, &["--set", "output.comments=false"]].concat();
    for (with_fields, plain) in [
        (text("MARK", "{serial:06}/{sku}"), text("MARK", "000417/plate")),
        (text("MARK", "{date} {date:%d.%m.%y} {shift}"), text("MARK", "2026-11-23 23.11.26 late")),
        (text("MARK", "{csv:LOT} {lot} {{serial}}"), text("MARK", "A7^ %%%%%%c {lot} %%123serial%%125")),
        (mtext(r"{\C1;No} \{serial:06\}"), mtext(r"{\C1;No} 000417")),
        (mtext(r"{serial:04x}\PA"), mtext(r"01a1\PA")),
    ] {
        desk.write("fields.dxf", dxf(&with_fields));
        let (report, _) = corrected(&desk, &["plate.obj", "fields.dxf"], &options);
        let made = desk.read("out.dxf");
        desk.write("plain.dxf", dxf(&plain));
        let (without, _) = corrected(&desk, &["plate.obj", "plain.dxf"], &options);
        assert!(made == desk.read("out.dxf"), "{with_fields}");
        assert_eq!(report["content"]["serial"], 417);
        assert_eq!(report["content"]["date"], "2026-11-23T14:05:00");
        assert_eq!(report["content"]["shift"], "late");
        assert!(without.get("content").is_none());
    }
    let svg = |text: &str| {
        format!(
            "<svg xmlns='http://www.w3.org/2000/svg' width='60mm' height='20mm' viewBox='0 0 60 20'><text x='2' y='15' \
             font-size='6'>{text}</text></svg>"
        )
    };
    desk.write("fields.svg", svg("{serial:06} {csv:LOT}"));
    corrected(&desk, &["plate.obj", "fields.svg"], &options);
    let made = desk.read("out.dxf");
    desk.write("fields.svg", svg("000417 A7^%%c"));
    corrected(&desk, &["plate.obj", "fields.svg"], &options);
    assert!(made == desk.read("out.dxf"));
}

#[test]
fn a_field_without_a_value_refuses_the_drawing_by_name() {
    let desk = Desk::new();
    desk.write("plate.obj", PLATE);
    for (field, given, words) in [
        ("{serial:06}", "", "no serial number is given"),
        ("{serial:02}", "serial=417", "417 has more than 2 digits"),
        ("{csv:LOT}", "csv.Lot=A7", "there is no column `LOT`; the columns are Lot"),
        ("{shift}", "", "no shift is given"),
        ("{date:%Q}", "", "the format `%Q` is not known; write %Y, %m, %d, %H, %M, %S, %j, %V or %y."),
        ("{date:dd.MM.yyyy}", "", "the format `dd.MM.yyyy` is not known; write %Y, %m, %d"),
        ("{serial:6}", "serial=4", "is not known; write 06 for six digits, 06x or 06X for hexadecimal ones."),
    ] {
        desk.write("fields.dxf", dxf(&text("MARK", &format!("No {field}"))));
        let given: &[&str] = if given.is_empty() { &[] } else { &["--content", given] };
        let output =
            run(&desk, &["plate.obj", "fields.dxf"], &[AS_DRAWN, given, &["--losses", "warn"]].concat());
        output.refused(1, &["content-missing", field, words, "layer MARK", "TEXT 31"]);
        // What is given need not be given.
        if field.contains("02") {
            assert!(!output.err.contains("--content serial="), "{}", output.err);
        }
        assert_eq!(output.err.contains("room for all numbers"), words.contains("more than 2 digits"));
        assert!(!desk.path("out.dxf").exists());
    }
    for (option, words) in [
        (["--content", "serial"], "gives no value"),
        (["--content", "serial=x"], "gives no whole number"),
        (["--content", "serial=-1"], "gives no whole number from 0 to 18446744073709551615."),
        (["--content", "lot=A7"], "names no field"),
        (["--content", "csv.=A7"], "names no field"),
        (["--date", "23.11.2026"], "is not a date"),
        (["--date", "26-11-23"], "is not a date"),
    ] {
        run(&desk, &["plate.obj", "fields.dxf"], &[AS_DRAWN, &option].concat()).refused(2, &[words]);
    }
}

/// Every kind of code, on a plate, in rectangles in any direction, dark or light.
#[test]
fn an_independent_reader_decodes_every_code() {
    let desk = Desk::new();
    desk.write("plate.obj", PLATE);
    let gs1 = "(01)09501101020917(10)AB{serial:04}(21)7";
    for (kind, content, size, turned, more, expected) in [
        ("data-matrix", "SN{serial:06}", [12.0, 12.0], 0.0, "", "SN000417"),
        ("data-matrix", "SN{serial:06}", [12.0, 20.0], 30.0, "", "SN000417"),
        ("data-matrix", "SN{serial:06}", [12.0, 12.0], -75.0, ", invert = true, quiet_zone = 3", "SN000417"),
        ("data-matrix", "Größe {csv:LOT}", [30.0, 10.0], 0.0, ", rectangular = true", "Größe A7"),
        ("gs1-data-matrix", gs1, [15.0, 15.0], 0.0, "", "(01)09501101020917(10)AB0417(21)7"),
        ("qr", "https://example.com/{serial}", [20.0, 20.0], 10.0, "", "https://example.com/417"),
        (
            "qr",
            "https://example.com/{serial}",
            [20.0, 20.0],
            0.0,
            ", invert = true",
            "https://example.com/417",
        ),
        // Their UTF-8 could be read as Shift-JIS.
        ("qr", "ИЗДЕЛИЕ {serial}", [20.0, 20.0], 0.0, "", "ИЗДЕЛИЕ 417"),
        ("qr", "ΕΛΛΗΝΙΚΑ ÄÖÜ {csv:LOT}", [20.0, 20.0], 0.0, "", "ΕΛΛΗΝΙΚΑ ÄÖÜ A7"),
        ("qr", "日本 €", [20.0, 20.0], 0.0, "", "日本 €"),
        ("code-128", "Lot {csv:LOT}-{serial:08}", [50.0, 10.0], 0.0, "", "Lot A7-00000417"),
        ("code-128", "{serial:08}", [10.0, 50.0], 0.0, "", "00000417"),
        ("gs1-128", gs1, [80.0, 10.0], 0.0, "", "(01)09501101020917(10)AB0417(21)7"),
    ] {
        desk.write("code.dxf", dxf(&rectangle("DM", size, turned)));
        let set = codes(kind, content, more);
        let options =
            [AS_DRAWN, &["--set", &set, "--content", "serial=417", "--content", "csv.LOT=A7"]].concat();
        let (report, pattern) = corrected(&desk, &["plate.obj", "code.dxf"], &options);
        let code = &report["content"]["codes"][0];
        assert_eq!((code["kind"].as_str(), code["handle"].as_str()), (Some(kind), Some("2F")));
        assert!(number(code, "/max_distortion_percent") < 1e-6, "{code}");
        let side = number(code, "/cell_mm");
        assert!((number(code, "/cell_on_part_mm/0") - side).abs() < 1e-9);
        // Within its placeholder.
        let [modules, quiet] = ["/modules/0", "/quiet_zone"].map(|pointer| number(code, pointer));
        assert!((modules + 2.0 * quiet) * side <= size[0].max(size[1]) + 1e-9);
        assert!(notices(&report).contains(&"code-outlines"));
        let is_light = more.contains("invert");
        if let Some(found) = decoded(&polygons(&pattern, |at| at), 30.0, is_light) {
            assert_eq!(found, [expected], "{kind} {content}");
        }
    }
}

/// On a cylinder the code is decoded unrolled, where its modules are exactly square, and as a camera above it sees it.
#[test]
fn a_code_on_a_cylinder_is_decoded_unrolled_and_from_above() {
    let desk = Desk::new();
    let radius = 15.0;
    for (kind, size) in [("data-matrix", [12.0, 12.0]), ("qr", [14.0, 14.0]), ("code-128", [20.0, 8.0])] {
        desk.write("code.dxf", dxf(&rectangle("DM", size, 0.0)));
        let set = codes(kind, "SN{serial:06}", "");
        let options = ["--cylinder", "30,60", "--place", "2,0", "--set", &set, "--content", "serial=17"];
        let (report, pattern) = corrected(&desk, &["code.dxf"], &options);
        let code = &report["content"]["codes"][0];
        assert!(number(code, "/max_distortion_percent") < 0.5, "{code}");
        let unrolled = polygons(&pattern, |[x, y]| [radius * (x / radius).asin(), y]);
        // All corners are on the grid of the modules, to the tolerance of the drawing.
        let cell = number(code, "/cell_mm");
        let columns = number(code, "/modules/0");
        let left = 2.0 - columns * cell / 2.0;
        for [x, _] in unrolled.iter().flatten() {
            let off = (x - left) / cell - ((x - left) / cell).round();
            if kind == "code-128" {
                assert!(off.abs() * cell < 0.01, "{x} is {off} cells beside the grid");
            }
        }
        for seen in [unrolled, polygons(&pattern, |at| at)] {
            if let Some(found) = decoded(&seen, 30.0, false) {
                assert_eq!(found, ["SN000017"], "{kind}");
            }
        }
    }
}

/// On a part that is curved in two directions: as seen along its normal, and from above.
#[test]
fn a_code_on_the_mouse_is_decoded_along_its_normal_and_from_above() {
    let desk = Desk::new();
    desk.write("code.dxf", dxf(&rectangle("DM", [14.0, 14.0], 20.0)));
    let set = codes("data-matrix", "MOUSE {serial:06}", "");
    let mouse = format!("{}/examples/parts/mouse.glb", env!("CARGO_MANIFEST_DIR"));
    let options =
        ["--place", "0,20", "--set", &set, "--content", "serial=17", "--xyz", "on-part.csv", "--fill", "0.1"];
    let (report, pattern) = corrected(&desk, &[&mouse, "code.dxf"], &options);
    let code = &report["content"]["codes"][0];
    assert!(number(code, "/max_distortion_percent") < 10.0, "{code}");
    assert!(number(code, "/max_distortion_percent") > 0.0, "{code}");
    assert!(!notices(&report).contains(&"code-outlines"));
    let mut contours = pattern.clone();
    contours.paths.retain(|path| pattern.layers[path.layer].name == "DM");
    let above = polygons(&contours, |at| at);
    // The points on the part, along the normal of the plane through three corners.
    let points: Vec<nalgebra::Vector3<f64>> = on_part(&desk.text("on-part.csv"));
    let middle = points.iter().sum::<nalgebra::Vector3<f64>>() / points.len() as f64;
    let spread = points
        .iter()
        .map(|point| (point - middle) * (point - middle).transpose())
        .sum::<nalgebra::Matrix3<f64>>();
    let axes = spread.symmetric_eigen();
    let least = (0..3).min_by(|a, b| axes.eigenvalues[*a].total_cmp(&axes.eigenvalues[*b])).unwrap();
    let normal = axes.eigenvectors.column(least) * axes.eigenvectors.column(least).z.signum();
    let x = (nalgebra::Vector3::x() - normal * normal.x).normalize();
    let y = normal.cross(&x);
    let height = |at: [f64; 2]| {
        let near = |point: &&nalgebra::Vector3<f64>| (point.x - at[0]).hypot(point.y - at[1]);
        points.iter().min_by(|a, b| near(a).total_cmp(&near(b))).unwrap().z
    };
    let along_normal = polygons(&contours, |at| {
        let point = nalgebra::Vector3::new(at[0], at[1], height(at)) - middle;
        [point.dot(&x), point.dot(&y)]
    });
    for seen in [above, along_normal] {
        if let Some(found) = decoded(&seen, 30.0, false) {
            assert_eq!(found, ["MOUSE 000017"]);
        }
    }
}

/// The points of a list of points on the part.
fn on_part(list: &str) -> Vec<nalgebra::Vector3<f64>> {
    let mut lines = list.lines().filter(|line| !line.starts_with('#'));
    let names: Vec<&str> = lines.next().unwrap().split(',').collect();
    let place = ["x_mm", "y_mm", "z_mm"].map(|name| names.iter().position(|other| *other == name).unwrap());
    let point = |line: &str| {
        let values: Vec<&str> = line.split(',').collect();
        nalgebra::Vector3::from(place.map(|index| values[index].parse::<f64>().unwrap()))
    };
    lines.map(point).collect()
}

#[test]
fn codes_that_cannot_be_marked_are_refused_or_warned_of() {
    let desk = Desk::new();
    desk.write("plate.obj", PLATE);
    let line = "0\nLINE\n5\n30\n8\nMARK\n10\n-30\n20\n-30\n11\n30\n21\n-30\n";
    let check = |entities: &str, set: &str, more: &[&str]| {
        desk.write("code.dxf", dxf(&format!("{line}{entities}")));
        run(&desk, &["plate.obj", "code.dxf"], &[AS_DRAWN, &["--set", set], more].concat())
    };
    let placeholder = rectangle("DM", [12.0, 12.0], 0.0);
    let matrix = codes("data-matrix", "SN17", "");
    let circle = "0\nCIRCLE\n5\n33\n8\nDM\n10\n0\n20\n0\n40\n5\n";
    check(circle, &matrix, &[]).refused(1, &["code-placeholder", "CIRCLE 33", "closed rectangle"]);
    check(&rectangle("DM", [12.0, 0.0], 0.0), &matrix, &[]).refused(1, &[]);
    check(&placeholder, &codes("data-matrix", &"x".repeat(3000), ""), &[])
        .refused(1, &["code-content", "longer than"]);
    check(&placeholder, &codes("gs1-data-matrix", "17", ""), &[])
        .refused(1, &["code-content", "application identifier"]);
    check(&placeholder, &codes("code-128", "ä", ""), &[]).refused(1, &["code-content", "no character 'ä'"]);
    check(&placeholder, &codes("qr", "{serial}", ""), &[]).refused(1, &["content-missing", "{serial}"]);
    check(&placeholder, &codes("data-matrix", "", ""), &[]).refused(2, &["content of a code is empty"]);
    check(&placeholder, &codes("datamatrix", "1", ""), &[]).refused(2, &["Did you mean `data-matrix`?"]);
    check(&placeholder, &codes("qr", "1", ", rectangular = true"), &[]).refused(2, &["no rectangular form"]);
    let report = |output: desk::Output| serde_json::from_str::<Value>(&output.out).unwrap();
    let missing = report(check("", &matrix, &[]));
    assert!(notices(&missing).contains(&"code-layer-missing"));
    let fine = report(check(&placeholder, &matrix, &["--set", "optics.spot_mm=2"]));
    assert!(notices(&fine).contains(&"code-finer-than-spot"));
    // Close to the edge of a ball, or with a plain projection, cells are stretched.
    desk.write("code.dxf", dxf(&rectangle("DM", [12.0, 12.0], 0.0)));
    let options = ["--cylinder", "30,60", "--place", "7,0", "--method", "none", "--set", &matrix];
    let (distorted, _) = corrected(&desk, &["code.dxf"], &options);
    assert!(notices(&distorted).contains(&"code-distorted"), "{:?}", notices(&distorted));
    // The last column of modules of 1 mm is from x = 11 to 12 mm, where a plain projection stretches it to this arc.
    let stretch = number(&distorted, "/content/codes/0/max_distortion_percent");
    let arc = 15.0 * ((12.0f64 / 15.0).asin() - (11.0f64 / 15.0).asin());
    assert!((stretch - (arc - 1.0) * 100.0).abs() < 0.2, "{stretch}");
}

/// A drawing with blocks.
fn dxf_with_blocks(blocks: &str, entities: &str) -> String {
    dxf(entities).replace(
        "0\nSECTION\n2\nENTITIES",
        &format!("0\nSECTION\n2\nBLOCKS\n{blocks}0\nENDSEC\n0\nSECTION\n2\nENTITIES"),
    )
}

/// An insert of the block CODE, turned, with more groups.
fn insert([x, y]: [f64; 2], scale: f64, turned_deg: f64, more: &str) -> String {
    format!(
        "0\nINSERT\n5\n40\n8\nLABEL\n2\nCODE\n10\n{x}\n20\n{y}\n41\n{scale}\n42\n{scale}\n50\n{turned_deg}\n{more}"
    )
}

/// The rectangle in the definition of a block becomes a code wherever the block is inserted; other rectangles and the attributes of
/// the inserts are drawn as they are.
#[test]
fn the_rectangle_of_a_block_becomes_a_code_in_every_insert() {
    let desk = Desk::new();
    desk.write("plate.obj", PLATE);
    let block = format!(
        "0\nBLOCK\n8\n0\n2\nCODE\n70\n0\n10\n0\n20\n0\n{}0\nENDBLK\n",
        rectangle("0", [12.0, 12.0], 0.0)
    );
    let frame = rectangle("LABEL", [70.0, 30.0], 0.0);
    let attribute =
        |kind: &str, text: &str| format!("0\n{kind}\n5\n41\n8\nLABEL\n10\n-5\n20\n-12\n40\n3\n1\n{text}\n");
    let with_attribute = insert([-20.0, 0.0], 1.0, 0.0, "66\n1\n")
        + &attribute("ATTRIB", "{serial:04}")
        + "2\nSERIAL\n0\nSEQEND\n";
    let inserts = with_attribute + &insert([15.0, 0.0], 1.25, 30.0, "");
    desk.write("code.dxf", dxf_with_blocks(&block, &(frame.clone() + &inserts)));
    let set = "content.codes=[{block = 'Code', kind = 'data-matrix', content = 'SN{serial:06}'}]";
    let options =
        [AS_DRAWN, &["--set", set, "--content", "serial=417", "--set", "output.comments=false"]].concat();
    let (report, pattern) = corrected(&desk, &["plate.obj", "code.dxf"], &options);
    let codes = report["content"]["codes"].as_array().unwrap();
    assert_eq!(codes.len(), 2);
    for (code, size) in codes.iter().zip([12.0, 15.0]) {
        assert_eq!((code["layer"].as_str(), code["block"].as_str()), (Some("LABEL"), Some("Code")));
        let modules = number(code, "/modules/0") + 2.0 * number(code, "/quiet_zone");
        assert!((number(code, "/cell_mm") * modules - size).abs() < 1e-9, "{code}");
    }
    // The cells are what the inserts add to the frame and the text of the attribute.
    desk.write("code.dxf", dxf(&(frame + &attribute("TEXT", "0417"))));
    let (_, plain) = corrected(&desk, &["plate.obj", "code.dxf"], &options);
    let cells: Vec<Vec<[f64; 2]>> = polygons(&pattern, |at| at)
        .into_iter()
        .filter(|polygon| !polygons(&plain, |at| at).contains(polygon))
        .collect();
    assert_eq!(pattern.paths.len() - plain.paths.len(), cells.len());
    for middle in [-20.0, 15.0] {
        let one: Vec<_> = cells.iter().filter(|cell| (cell[0][0] - middle).abs() < 12.0).cloned().collect();
        if let Some(found) = decoded(&one, 30.0, false) {
            assert_eq!(found, ["SN000417"], "{middle}");
        }
    }
    // In an SVG, a copy of an element is what an insert of a block is in a DXF.
    desk.write(
        "code.svg",
        "<svg xmlns='http://www.w3.org/2000/svg' width='60mm' height='20mm' viewBox='0 0 60 20'><defs><rect id='Code' \
         width='12' height='12'/></defs><rect x='1' y='1' width='58' height='18' fill='none' stroke='black'/>\
         <use href='#Code' x='4' y='4'/></svg>",
    );
    let (report, pattern) = corrected(&desk, &["plate.obj", "code.svg"], &options);
    assert_eq!(report["content"]["codes"].as_array().unwrap().len(), 1);
    let cells: Vec<_> = polygons(&pattern, |at| at)
        .into_iter()
        .filter(|cell| cell.iter().all(|&[x, y]| 4.0 < x && x < 16.0 && 4.0 < y && y < 16.0))
        .collect();
    if let Some(found) = decoded(&cells, 30.0, false) {
        assert_eq!(found, ["SN000417"]);
    }
}

#[test]
fn blocks_of_codes_that_cannot_be_used_are_named() {
    let desk = Desk::new();
    desk.write("plate.obj", PLATE);
    let block = "0\nBLOCK\n8\n0\n2\nCODE\n70\n0\n10\n0\n20\n0\n0\nCIRCLE\n5\n33\n8\n0\n10\n0\n20\n0\n40\n5\n0\nENDBLK\n";
    desk.write("code.dxf", dxf_with_blocks(block, &insert([0.0, 0.0], 1.0, 0.0, "")));
    let code = |place: &str| format!("content.codes=[{{{place}kind = 'qr', content = '1'}}]");
    let check = |place: &str| {
        let set = code(place);
        run(&desk, &["plate.obj", "code.dxf"], &[AS_DRAWN, &["--set", &set]].concat())
    };
    check("block = 'CODE', ").refused(1, &["code-placeholder", "The block CODE", "CIRCLE 33"]);
    check("block = 'CODE', layer = 'LABEL', ").refused(2, &["both a layer and a block"]);
    check("").refused(2, &["no layer and no block"]);
    let missing: Value = serde_json::from_str(&check("block = 'DMX', ").out).unwrap();
    assert!(notices(&missing).contains(&"code-layer-missing"), "{missing}");
}

/// The area that closed polygons enclose by the even-odd rule.
fn enclosed(polygons: &[Vec<[f64; 2]>]) -> f64 {
    let sides = |polygon: &[[f64; 2]]| -> Vec<[[f64; 2]; 2]> {
        polygon.iter().zip(polygon.iter().cycle().skip(1)).map(|(from, to)| [*from, *to]).collect()
    };
    let is_inside = |[x, y]: [f64; 2], polygon: &[[f64; 2]]| {
        let is_crossed = |[[x1, y1], [x2, y2]]: &[[f64; 2]; 2]| {
            (*y1 > y) != (*y2 > y) && x < (x2 - x1) * (y - y1) / (y2 - y1) + x1
        };
        sides(polygon).iter().filter(|side| is_crossed(side)).count() % 2 == 1
    };
    let area = |(index, polygon): (usize, &Vec<[f64; 2]>)| {
        let sides = sides(polygon);
        // Contours meet at corners only, so the middle of a side is on no other contour.
        let [from, to] = sides[0];
        let middle = [(from[0] + to[0]) / 2.0, (from[1] + to[1]) / 2.0];
        let around = polygons.iter().enumerate().filter(|(other, _)| *other != index);
        let is_hole = around.filter(|(_, polygon)| is_inside(middle, polygon)).count() % 2 == 1;
        let area = sides.iter().map(|[[x1, y1], [x2, y2]]| x1 * y2 - x2 * y1).sum::<f64>().abs() / 2.0;
        if is_hole { -area } else { area }
    };
    polygons.iter().enumerate().map(area).sum()
}

/// The lines of a fill cover the dark cells of codes and the letters of outline fonts, also in tiles round the part: their length is
/// the area by their distance.
#[test]
fn codes_and_letters_of_outline_fonts_are_filled() {
    let desk = Desk::new();
    desk.write("plate.obj", PLATE);
    let style = "0\nSECTION\n2\nTABLES\n0\nTABLE\n2\nSTYLE\n0\nSTYLE\n2\nARIAL\n70\n0\n40\n0\n41\n1\n50\n0\n71\n0\n3\narial.ttf\n0\n\
                 ENDTAB\n0\nENDSEC\n";
    let letters = dxf("0\nTEXT\n5\n31\n8\nDM\n10\n-15\n20\n-3\n40\n8\n7\nARIAL\n1\nAB8\n");
    let letters = letters.replacen("0\nSECTION\n2\nENTITIES", &format!("{style}0\nSECTION\n2\nENTITIES"), 1);
    let set = codes("data-matrix", "SN{serial:06}", "");
    let with_code = ["--set", &set, "--content", "serial=417"];
    let placed = |x: f64| {
        let [left, right] = [x - 6.0, x + 6.0].map(|x| format!("10\n{x}\n"));
        rectangle("DM", [12.0, 12.0], 0.0).replace("10\n-6\n", &left).replace("10\n6\n", &right)
    };
    let filled = |drawing: &str, options: &[&str]| {
        desk.write("job.dxf", drawing);
        let fill = ["--fill", "0.1", "--set", "fill.angle_deg=30"];
        let output = run(&desk, &[], &[&["job.dxf"], options, &fill].concat());
        assert_eq!(output.code, 0, "{}", output.err);
        let report: Value = serde_json::from_str(&output.out).unwrap();
        number(&report, "/fill/length_mm") * 0.1
    };
    let plain = |drawing: &str, options: &[&str]| {
        desk.write("job.dxf", drawing);
        enclosed(&polygons(&corrected(&desk, &["plate.obj", "job.dxf"], options).1, |at| at))
    };
    let code = dxf(&placed(0.0));
    let of_code = plain(&code, &[AS_DRAWN, &with_code].concat());
    let of_letters = plain(&letters, AS_DRAWN);
    assert!(of_code > 30.0 && of_letters > 30.0, "{of_code} {of_letters}");
    let round = dxf(&[-60.0, -20.0, 20.0, 60.0].map(placed).concat());
    let cylinder = ["--cylinder", "66,120", "--place", "0,0"];
    for (name, found, expected) in [
        ("code", filled(&code, &[&cylinder, &with_code[..]].concat()), of_code),
        ("letters", filled(&letters, &cylinder), of_letters),
        ("round", filled(&round, &[&cylinder, &with_code[..], &["--rotary"]].concat()), 4.0 * of_code),
    ] {
        assert!((found / expected - 1.0).abs() < 0.02, "{name}: lines for {found} mm2 in {expected} mm2");
    }
}

const LIST: &str = "LOT,Name\nA7,one\nA8,two\nA9,three\n";

fn listed(desk: &Desk, list: &str, options: &[&str]) -> desk::Output {
    desk.write("batch.csv", list);
    let inputs = ["correct", "plate.obj", "label.dxf", "--list", "batch.csv", "--out-dir", "out"];
    desk.isomark(&[&inputs[..], AS_DRAWN, options].concat())
}

fn names(desk: &Desk) -> Vec<String> {
    let Ok(folder) = fs_err::read_dir(desk.path("out")) else { return Vec::new() };
    let mut names: Vec<String> =
        folder.map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    names
}

/// Each drawing of a list is the one that its values give alone.
#[test]
fn a_list_gives_a_drawing_for_each_row() {
    let desk = Desk::new();
    desk.write("plate.obj", PLATE);
    desk.write("label.dxf", dxf(&text("MARK", "{serial:04} {csv:LOT}")));
    let output = listed(&desk, LIST, &["--set", "serial.start=10", "--set", "serial.step=5", "--json"]);
    assert_eq!(output.code, 0, "{}", output.err);
    let report = schemas::document(&output.out);
    let third = json!({ "row": 3, "line": 4, "serial": 20, "drawing": "batch-0003.dxf" });
    assert_eq!((&report["rows"][2], &report["list"]), (&third, &"batch.csv".into()));
    assert!(output.err.contains("batch.csv: 3 drawings in out"), "{}", output.err);
    assert_eq!(names(&desk), ["batch-0001.dxf", "batch-0002.dxf", "batch-0003.dxf"]);
    for (number, serial, lot) in [(1, 10, "A7"), (2, 15, "A8"), (3, 20, "A9")] {
        let [serial, lot] = [format!("serial={serial}"), format!("csv.LOT={lot}")];
        corrected(
            &desk,
            &["plate.obj", "label.dxf"],
            &[AS_DRAWN, &["--content", &serial, "--content", &lot]].concat(),
        );
        assert!(desk.read("out.dxf") == desk.read(&format!("out/batch-{number:04}.dxf")));
    }
}

/// What a single drawing warns of, a list warns of once.
#[test]
fn a_list_reports_the_warnings_of_its_drawings() {
    let desk = Desk::new();
    desk.write("plate.obj", PLATE);
    desk.write("label.dxf", dxf(&text("MARK", "{serial:04} {csv:LOT}")));
    let output = listed(&desk, LIST, &["--set", &codes("qr", "{serial}", "")]);
    assert_eq!(output.code, 0, "{}", output.err);
    let missing = "row 1: warning: no qr code is marked: the drawing has nothing on the layer DM";
    assert!(output.err.contains(missing) && output.err.matches("no qr code").count() == 1, "{}", output.err);
}

#[test]
fn bad_rows_refuse_a_list_before_anything_is_written_or_are_left_out_by_name() {
    let desk = Desk::new();
    desk.write("plate.obj", PLATE);
    desk.write("label.dxf", dxf(&text("MARK", "{serial:04} {csv:LOT}")));
    for (list, words) in [
        (
            "LOT,Name\nA7,one\n,two\n",
            &["content-missing", "Row 2", "the column `LOT` is empty", "line 3"][..],
        ),
        ("Lot\nA7\n", &["content-missing", "Row 1", "there is no column `LOT`; the columns are Lot"]),
        ("LOT\nA7\n\"A8\nA9\n", &["list-unreadable", "column LOT", "line 3", "quote may be missing"]),
        ("LOT,Name\nA7\n", &["list-unreadable", "no value for this column", "column Name", "line 2"]),
        ("LOT\n\u{2}\n", &["list-unreadable", "control character U+0002"]),
        ("LOT,LOT\n1,2\n", &["list-unreadable", "two columns are named `LOT`"]),
        ("LOT\n", &["list-empty"]),
        ("", &["list-unreadable", "the list is empty"]),
    ] {
        listed(&desk, list, &[]).refused(1, words);
        assert_eq!(names(&desk), [""; 0]);
    }
    listed(&desk, LIST, &["--set", "serial.last=2"]).refused(1, &["serial-used-up", "Row 3", "line 4"]);
    assert_eq!(names(&desk), [""; 0]);
    let skipped = listed(&desk, "LOT,Name\nA7,one\n,two\nA9,three\n", &["--set", "content.bad_rows=skip"]);
    assert_eq!(skipped.code, 0, "{}", skipped.err);
    for words in ["Row 2", "the serial number 2 will not be used", "2 drawings in out; 1 row is left out"] {
        assert!(skipped.err.contains(words), "{}", skipped.err);
    }
    assert_eq!(names(&desk), ["batch-0001.dxf", "batch-0003.dxf"]);
    listed(&desk, LIST, &["--content", "serial=7"]).refused(2, &["`--list` those of many", "serial.start"]);
    desk.isomark(&["correct", "plate.obj", "label.dxf", "--list", "batch.csv"]).refused(2, &["--out-dir"]);
}

/// Drawings of an earlier, longer list would be marked again.
#[test]
fn drawings_of_an_earlier_list_are_named() {
    let desk = Desk::new();
    desk.write("plate.obj", PLATE);
    desk.write("label.dxf", dxf(&text("MARK", "{csv:LOT}")));
    let first = listed(&desk, LIST, &[]);
    assert!(first.code == 0 && !first.err.contains("not part of this mark"), "{}", first.err);
    desk.write("out/batch-x.dxf", "");
    let second = listed(&desk, "LOT\nB1\n", &[]);
    assert_eq!(second.code, 0, "{}", second.err);
    let words = "an earlier one: batch-0002.dxf, batch-0003.dxf; remove";
    assert!(second.err.contains(words), "{}", second.err);
}

/// A list whose values are on no drawing gives equal drawings; a field that is misspelt is a text.
#[test]
fn values_without_a_field_and_misspelt_fields_are_warned_of() {
    let desk = Desk::new();
    desk.write("plate.obj", PLATE);
    let placeholder = rectangle("DM", [12.0, 12.0], 0.0);
    let code = codes("qr", "SN{serail}", "");
    for (label, options, expected) in [
        ("{Serial}", &["--content", "serial=5"][..], &["field-misspelt", "content-unused"][..]),
        ("fixed", &["--content", "csv.LOT=5"], &["content-unused"]),
        ("{serial} {{serial}} {lot}", &["--content", "serial=5", "--content", "csv.LOT=5"], &[]),
        ("fixed", &["--set", &code], &["field-misspelt"]),
        ("fixed", &["--content", "serial=5", "--set", &codes("qr", "SN{serial}", "")], &[]),
    ] {
        desk.write("label.dxf", dxf(&(text("MARK", label) + &placeholder)));
        let (report, _) = corrected(&desk, &["plate.obj", "label.dxf"], &[AS_DRAWN, options].concat());
        let found = notices(&report);
        for code in ["field-misspelt", "content-unused"] {
            assert_eq!(found.contains(&code), expected.contains(&code), "{label} {options:?}: {found:?}");
        }
    }
    desk.write("label.dxf", dxf(&text("MARK", "{SERIAL:04}")));
    let output = listed(&desk, LIST, &[]);
    assert_eq!(output.code, 0, "{}", output.err);
    for words in ["row 1: warning: TEXT", "write `{serial:04}`", "a serial number and values of LOT"] {
        assert_eq!(output.err.matches(words).count(), 1, "{words}: {}", output.err);
    }
    // A list may have columns that the drawing does not use.
    desk.write("label.dxf", dxf(&text("MARK", "{serial:04}")));
    assert!(!listed(&desk, LIST, &[]).err.contains("given, but not marked"));
}

#[test]
fn a_list_in_tiles_has_one_file_for_each_row_or_is_refused() {
    let desk = Desk::new();
    desk.write("plate.obj", PLATE);
    desk.write("label.dxf", dxf(&text("MARK", "{csv:LOT}")));
    desk.write("batch.csv", LIST);
    let list = ["correct", "--cylinder", "60,100", "label.dxf", "--list", "batch.csv", "--out-dir", "out"];
    let with = |more: &[&str]| desk.isomark(&[&list[..], &["--rotary"], more].concat());
    with(&["--tiles-as", "files"]).refused(2, &["one drawing for each row", "--tiles-as layers"]);
    with(&["--set", "rotary.as=files"]).refused(2, &["one drawing for each row"]);
    assert_eq!(names(&desk), [""; 0]);
    assert_eq!(with(&[]).code, 0);
    assert_eq!(names(&desk).len(), 3);
}

/// The name of a shape is no SKU, and the name of a part is.
#[test]
fn a_shape_on_the_command_line_has_no_sku() {
    let desk = Desk::new();
    desk.write("plate.obj", PLATE);
    desk.write("label.dxf", dxf(&text("MARK", "{sku}")));
    let shape = ["--cylinder", "60,100", "--place", "0,0"];
    run(&desk, &["label.dxf"], &shape).refused(1, &["content-missing", "no SKU is given", "--sku"]);
    assert_eq!(run(&desk, &["label.dxf"], &[&shape[..], &["--sku", "can"]].concat()).code, 0);
    let (report, _) = corrected(&desk, &["plate.obj", "label.dxf"], AS_DRAWN);
    assert_eq!(report["pattern"]["facts"]["fields"][0]["value"], "plate");
}

/// Round a cylinder, a side of a cell becomes the chord of its arc, wherever it is.
#[test]
fn codes_round_a_part_are_measured_on_it() {
    let desk = Desk::new();
    let radius = 15.0f64;
    let circumference = std::f64::consts::TAU * radius;
    let mut entities = String::new();
    for side in 0..4 {
        let middle = (f64::from(side) - 1.5) * circumference / 4.0;
        let corners = [[-6.0, -6.0], [6.0, -6.0], [6.0, 6.0], [-6.0, 6.0]];
        entities += "0\nLWPOLYLINE\n8\nDM\n90\n4\n70\n1\n";
        for [x, y] in corners {
            entities += &format!("10\n{}\n20\n{y}\n", x + middle);
        }
    }
    desk.write("code.dxf", dxf(&entities));
    let options = ["--cylinder", "30,60", "--rotary", "--set", &codes("data-matrix", "SN17", "")];
    let (report, _) = corrected(&desk, &["code.dxf"], &options);
    let found = report["content"]["codes"].as_array().unwrap();
    assert_eq!(found.len(), 4);
    for code in found {
        let cell = number(code, "/cell_mm");
        let chord = 2.0 * radius * (cell / 2.0 / radius).sin();
        let [least, most] = [0, 1].map(|side| number(code, &format!("/cell_on_part_mm/{side}")));
        assert!((least - chord).abs() < 1e-9 && (most - cell).abs() < 1e-9, "{code}");
        let change = number(code, "/max_distortion_percent") / 100.0;
        assert!((change - (1.0 - chord / cell)).abs() < 1e-9, "{code}");
    }
}

/// A code without fields is known before a drawing is.
#[test]
fn the_check_of_a_station_finds_codes_that_can_never_be_made() {
    let desk = Desk::new();
    assert_eq!(desk.isomark(&["init", "line"]).code, 0);
    let check = |kind: &str, content: &str| {
        desk.isomark(&["check", "line/station.toml", "--set", &codes(kind, content, "")])
    };
    check("gs1-128", "01095011").refused(2, &["code-content", "application identifier"]);
    assert_eq!(check("gs1-128", "(01){csv:GTIN}").code, 0);
    let output = check("qr", "{serail}");
    assert!(output.code == 0 && output.out.contains("field-misspelt"), "{} {}", output.out, output.err);
}

/// A name from a list never becomes a path.
#[test]
fn values_of_a_list_name_no_files() {
    let desk = Desk::new();
    desk.write("plate.obj", PLATE);
    desk.write("label.dxf", dxf(&text("MARK", "{csv:LOT}")));
    let output = listed(&desk, "LOT\n../../x\nC:\\x\n", &[]);
    assert_eq!(output.code, 0, "{}", output.err);
    assert_eq!(names(&desk), ["batch-0001.dxf", "batch-0002.dxf"]);
}

/// The settings beside a drawing give its values, so every product of a station has the number that was given for it.
#[test]
fn a_station_takes_the_values_beside_the_drawing() {
    let desk = Desk::new();
    assert_eq!(desk.isomark(&["init", "line"]).code, 0);
    let mouse = format!("{}/examples/parts/mouse.glb", env!("CARGO_MANIFEST_DIR"));
    desk.write("line/hot/plate.glb", fs_err::read(mouse).unwrap());
    let station = ["watch", "line/station.toml", "--once"];
    assert_eq!(desk.isomark(&station).code, 0);
    let label = dxf(&("0\nTEXT\n8\nMARK\n10\n-10\n20\n10\n40\n3\n1\n{serial:04}\n".to_owned()
        + &rectangle("DM", [12.0, 12.0], 0.0)));
    desk.write("line/hot/plate@0017.dxf", &label);
    desk.write("line/hot/plate@0018.dxf", &label);
    let code =
        "codes = [{ layer = \"DM\", kind = \"data-matrix\", content = \"{csv.LOT}{csv:LOT}-{serial:04}\" }]";
    let values = format!("[content]\nserial = 17\ndate = \"2026-11-23\"\ncsv = {{ LOT = \"A7\" }}\n{code}\n");
    desk.write("line/hot/plate@0017.toml", values);
    let output = desk.isomark(&station);
    assert_eq!(output.code, 1, "{}", output.err);
    let report =
        serde_json::from_slice::<Value>(&desk.read("line/reports/plate/plate@0017.dxf.report.json")).unwrap();
    assert_eq!(report["content"]["serial"], 17);
    assert_eq!(report["content"]["codes"][0]["content"], "{csv.LOT}A7-0017");
    assert!(desk.path("line/import/plate@0017.dxf").exists());
    assert!(!desk.path("line/import/plate@0018.dxf").exists());
    let reason = desk.text("line/rejected/plate@0018.dxf.reason.txt");
    assert!(reason.contains("`{serial:04}` has no value"), "{reason}");
}

/// A code beside a serial number whose text gets wider: the code has the same place on every product.
#[test]
fn what_is_the_same_on_all_products_keeps_its_place() {
    let desk = Desk::new();
    desk.write("plate.obj", PLATE);
    desk.write("label.dxf", dxf(&(rectangle("DM", [12.0, 12.0], 0.0) + &text("MARK", "N{serial}"))));
    let corner = |serial: &str| {
        let code = codes("data-matrix", "constant", "");
        let options = [AS_DRAWN, &["--place", "7,9", "--set", &code, "--content", serial]].concat();
        let (report, pattern) = corrected(&desk, &["plate.obj", "label.dxf"], &options);
        let layer = |path: &&isomark::geometry::pattern::Path| pattern.layers[path.layer].name == "DM";
        let points = pattern.paths.iter().filter(layer).flat_map(|path| path.shape.flattened(0.01));
        let corner = points.fold([f64::MAX; 2], |low, at| [low[0].min(at.x), low[1].min(at.y)]);
        (corner, report["placement"]["anchor_mm"].clone())
    };
    let short = corner("serial=9");
    assert_eq!(short, corner("serial=123456789"));
}

/// The middle of the ink is that of its extents, measured in the corrected drawing on a plane.
#[test]
fn texts_of_fixed_length_are_placed_by_the_middle_of_what_is_marked() {
    let desk = Desk::new();
    desk.write("plate.obj", PLATE);
    let middle = |words: &str, content: &[&str]| {
        desk.write("label.dxf", dxf(&text("MARK", words)));
        let options = [AS_DRAWN, &["--place", "7,9"], content].concat();
        let (report, pattern) = corrected(&desk, &["plate.obj", "label.dxf"], &options);
        let codes: Vec<&str> =
            report["notices"].as_array().unwrap().iter().map(|n| n["code"].as_str().unwrap()).collect();
        (pattern.extents().center().x, codes.contains(&"field-off-center"))
    };
    let dated = ["--content", "serial=17", "--date", "2026-11-27"];
    let (x, is_noticed) = middle("{date:%d.%m.%Y} {serial:06}", &dated);
    assert!((x - 7.0).abs() < 0.3 && !is_noticed, "{x}");
    let other = ["--content", "serial=999999", "--date", "2029-10-30"];
    let (x, is_noticed) = middle("{date:%d.%m.%Y} {serial:06}", &other);
    assert!((x - 7.0).abs() < 0.3 && !is_noticed, "{x}");
    // The text is 18 letters long, and the field 10: the middle is far to the right.
    let (x, is_noticed) = middle("{csv:Name}", &["--content", "csv.Name=ABCDEFGHIJKLMNOPQR"]);
    assert!(x > 12.0 && is_noticed, "{x}");
}
