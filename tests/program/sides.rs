//! The sides of a part in `isomark inspect`: what can be marked, where a drawing fits, and which side is meant.

use serde_json::Value;

use crate::desk::{Desk, assert_near, drawing, notices, number, numbers, part};
use crate::glb::Glb;

const RADIUS: f64 = 33.0;
const HEIGHT: f64 = 110.0;

/// A can with flat lids, upright on z = 0.
fn closed_can() -> Vec<u8> {
    let lid = |up: f64, height: f64| {
        move |u: f64, v: f64| {
            // Seen from outside, u and v are right and up, so the lower lid runs the other way round.
            let angle = std::f64::consts::TAU * u * up;
            let radius = RADIUS * (1.0 - v);
            ([radius * angle.cos(), radius * angle.sin(), height], [0.0, 0.0, up])
        }
    };
    let can = Glb::default().can(RADIUS, HEIGHT);
    can.grid("lid", None, [200, 4], lid(1.0, HEIGHT)).grid("bottom", None, [200, 4], lid(-1.0, 0.0)).bytes()
}

fn side<'a>(facts: &'a Value, name: &str) -> &'a Value {
    let sides = facts["sides"].as_array().unwrap();
    assert_eq!(sides.len(), 6);
    sides.iter().find(|side| side["side"] == name).unwrap()
}

fn inspected(desk: &Desk, part: &str) -> Value {
    let output = desk.isomark(&["inspect", part, "--json"]);
    assert_eq!(output.code, 0, "{}", output.err);
    serde_json::from_str(&output.out).unwrap()
}

/// A rectangle of this size about the origin.
fn rectangle(width: f64, height: f64) -> String {
    let corners = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)]
        .map(|(x, y)| (x * width / 2.0, y * height / 2.0));
    let mut text =
        String::from("0\nSECTION\n2\nHEADER\n9\n$INSUNITS\n70\n4\n0\nENDSEC\n0\nSECTION\n2\nENTITIES\n");
    for (from, to) in corners.iter().zip(corners.iter().cycle().skip(1)) {
        text += &format!("0\nLINE\n8\nMARK\n10\n{}\n20\n{}\n11\n{}\n21\n{}\n", from.0, from.1, to.0, to.1);
    }
    text + "0\nENDSEC\n0\nEOF\n"
}

#[test]
fn the_sides_of_a_can_have_the_areas_of_the_formula() {
    let desk = Desk::new();
    desk.write("can.glb", closed_can());
    let facts = inspected(&desk, "can.glb");
    let limit = 60f64.to_radians();
    for name in ["+x", "-x", "+y", "-y"] {
        let side = side(&facts, name);
        assert_eq!((&side["curved"], &side["meant"]), (&true.into(), &true.into()), "{name}");
        let area = 2.0 * RADIUS * limit * HEIGHT;
        assert!((number(side, "/area_mm2") / area - 1.0).abs() < 0.05, "{name}: {side:#}, not {area}");
        assert_near(&numbers(side, "/extents_mm"), &[-RADIUS, 0.0, RADIUS, HEIGHT], 0.05);
        // The rectangle is inside what can be marked, by at most two cells and one facet.
        let half = RADIUS * limit.sin();
        let rectangle = numbers(side, "/rectangle_mm");
        assert!(rectangle[0] > -half && rectangle[2] < half && rectangle[1] > 0.0 && rectangle[3] < HEIGHT);
        assert_near(&rectangle, &[-half, 0.0, half, HEIGHT], 2.5);
        assert_near(&numbers(side, "/place_mm"), &[0.0, HEIGHT / 2.0], 1.0);
    }
    for name in ["+z", "-z"] {
        let side = side(&facts, name);
        assert_eq!((&side["curved"], &side["meant"]), (&false.into(), &false.into()), "{name}");
        let area = std::f64::consts::PI * RADIUS * RADIUS;
        assert!((number(side, "/area_mm2") / area - 1.0).abs() < 0.02, "{name}: {side:#}, not {area}");
        // The largest rectangle in a circle is a square.
        let half = RADIUS / 2f64.sqrt();
        assert_near(&numbers(side, "/rectangle_mm"), &[-half, -half, half, half], 1.5);
    }
    let text = desk.isomark(&["inspect", "can.glb"]).out;
    for words in [
        "side -y    curved, ",
        "at --facing=-y --place 0,55",
        "side +z    flat, 34",
        "to mark    probably side +x or -x or +y or -y, the largest curved side; without `--facing` the laser looks at the flat side +z",
    ] {
        assert!(text.contains(words), "{words}:\n{text}");
    }
}

/// A drawing of the size that is promised is accepted at the place that is suggested.
#[test]
fn a_drawing_fits_where_inspect_suggests_it() {
    let desk = Desk::new();
    desk.write("closed.glb", closed_can());
    for name in ["closed.glb", &part("mouse/fc020-gui.glb"), &part("can/fc020-gui.glb")] {
        let facts = inspected(&desk, name);
        for side in facts["sides"].as_array().unwrap() {
            let (facing, curved) = (side["side"].as_str().unwrap(), side["curved"].as_bool().unwrap());
            if !curved || side["meant"] == false {
                continue;
            }
            let corners = numbers(side, "/rectangle_mm");
            let place = numbers(side, "/place_mm");
            // The corners of a drawing bend outwards where a part is curved in both directions.
            desk.write(
                "box.dxf",
                rectangle(0.9 * (corners[2] - corners[0]), 0.9 * (corners[3] - corners[1])),
            );
            let options = format!("--facing={facing} --place {},{}", place[0], place[1]);
            desk.correct(name, "box.dxf", &options);
        }
    }
}

#[test]
fn a_drawing_on_a_flat_side_by_default_gets_a_notice() {
    let desk = Desk::new();
    desk.write("can.glb", closed_can());
    desk.write("box.dxf", rectangle(10.0, 6.0));
    let report = desk.correct("can.glb", "box.dxf", "");
    assert!(notices(&report).contains(&"flat-side"), "{:?}", notices(&report));
    let notice = report["notices"].as_array().unwrap().iter().find(|notice| notice["code"] == "flat-side");
    let message = notice.unwrap()["message"].as_str().unwrap();
    assert!(message.contains("flat side +z") && message.contains("+x, -x, +y, -y"), "{message}");
    // Not where the side was named, nor on the curved side, nor on a part that is flat everywhere or curved at the top.
    for options in ["--facing +z", "--facing=-y --place 0,55"] {
        assert!(!notices(&desk.correct("can.glb", "box.dxf", options)).contains(&"flat-side"), "{options}");
    }
    let plate = Glb::default()
        .grid("plate", None, [4, 4], |u, v| ([80.0 * u - 40.0, 60.0 * v - 30.0, 2.0], [0.0, 0.0, 1.0]));
    desk.write("plate.glb", plate.bytes());
    assert!(!notices(&desk.correct("plate.glb", "box.dxf", "")).contains(&"flat-side"));
    let report = desk.correct(&part("mouse/fc020-gui.glb"), &drawing("abc"), "");
    assert!(!notices(&report).contains(&"flat-side"));
}

#[test]
fn the_sides_are_drawn() {
    let desk = Desk::new();
    desk.write("can.glb", closed_can());
    let run = |options: &[&str]| {
        let output = desk.isomark(&[&["inspect", "can.glb"], options].concat());
        assert_eq!(output.code, 0, "{}", output.err);
    };
    run(&["--preview", "all.svg"]);
    let all = desk.text("all.svg");
    for words in [
        "--facing=+z",
        "--facing=-y",
        "probably meant",
        "at --place 0,55",
        "to the right +x of the part, upwards +z",
    ] {
        assert!(all.contains(words), "{words}");
    }
    // The axes in the README are those of the pictures.
    let readme = std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/README.md")).unwrap();
    let rights = readme.lines().find(|line| line.contains("·→")).unwrap();
    let is_axis = |word: &str| matches!(word, "+y" | "+z");
    let ups =
        readme.lines().find(|line| !line.trim().is_empty() && line.split_whitespace().all(is_axis)).unwrap();
    let rights: Vec<&str> = rights.split_whitespace().collect();
    for (named, up) in rights.chunks(3).zip(ups.split_whitespace()) {
        let [side, "·→", right] = named else { panic!("{named:?}") };
        let of_side = all.split(&format!(">--facing={side}<")).nth(1).unwrap();
        let axes = of_side.split("to the right ").nth(1).unwrap().split('<').next().unwrap();
        assert_eq!(axes, format!("{right} of the part, upwards {up}"), "{side}");
    }
    assert_eq!(all.matches("clipPath id=\"side").count(), 12, "a window and an outline each");
    run(&["--preview", "again.svg"]);
    assert_eq!(all, desk.text("again.svg"), "the same part gives the same bytes");
    run(&["--facing=-y", "--preview", "one.svg"]);
    let one = desk.text("one.svg");
    assert!(one.contains("--facing=-y") && !one.contains("--facing=+z"));
    run(&["--facing", "1,-1,0", "--preview", "slanted.svg"]);
    assert!(desk.text("slanted.svg").contains("--facing=0.7071,-0.7071,0.0000"));
    desk.isomark(&["inspect", "can.glb", "--preview", "all.png"]).refused(2, &["--preview", ".svg"]);
    desk.isomark(&["inspect", "can.glb", "--preview", "can.glb"]).refused(2, &["can.glb"]);
    desk.write("box.dxf", rectangle(10.0, 6.0));
    desk.isomark(&["inspect", "box.dxf", "--preview", "all.svg"]).refused(2, &["not a part"]);
}

/// The picture of a job names the part's own size, and shows the mark as it is on the part.
#[test]
fn the_flat_picture_has_the_size_of_the_part_and_the_unrolled_mark() {
    let desk = Desk::new();
    desk.write("can.glb", closed_can());
    desk.write("box.dxf", rectangle(40.0, 20.0));
    let picture = |options: &str| {
        desk.correct("can.glb", "box.dxf", &format!("{options} --preview picture.svg"));
        desk.text("picture.svg")
    };
    let front = picture("--facing=-y --place 0,55");
    assert!(front.contains("part 66 × 110 mm") && !front.contains("part ≈"));
    assert!(front.contains(">On the part<") && front.contains("corrected, as the laser draws it"));
    // The corrected box is narrower in the view: 2·33·sin(20/33) mm; on the part it is 40 mm wide again.
    let width = |picture: &str, panel: &str| {
        let panel = picture.split(&format!(">{panel}<")).nth(1).unwrap();
        let lines = panel.split("<g stroke-width=").nth(1).unwrap();
        let lines = lines.split("</g>").next().unwrap();
        extents_of_paths(lines)
    };
    let seen = 2.0 * RADIUS * (20.0 / RADIUS).sin();
    assert_near(&width(&front, "After"), &[seen, 20.0], 0.05);
    assert_near(&width(&front, "On the part"), &[40.0, 20.0], 0.05);
    assert_near(&width(&front, "Before"), &[40.0, 20.0], 0.05);
    // Uncorrected, the box is wider on the part than it was drawn.
    let plain = picture("--facing=-y --place 0,55 --method none");
    let on_part = 2.0 * RADIUS * (20.0 / RADIUS).asin();
    let [wide, high] = width(&plain, "On the part")[..] else { panic!("two sides") };
    // Away from the middle line, sections of a cylinder are ellipses and a little longer than its unrolled lines.
    assert!(wide > on_part - 0.1 && wide < on_part + 0.5, "{wide} {on_part}");
    assert!((20.0..23.0).contains(&high), "{high}");
    let text = picture("--facing=-y --place 0,55");
    let pairs = text.split('>').filter(|piece| piece.contains("</text") && piece.contains('('));
    for piece in pairs {
        assert_eq!(piece.matches('(').count(), piece.matches(')').count(), "{piece}");
    }
}

/// Width and height of all paths of this SVG text, whose steps are relative.
fn extents_of_paths(text: &str) -> Vec<f64> {
    let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
    for data in text.split(" d=\"").skip(1).map(|rest| rest.split('"').next().unwrap()) {
        let mut pen = [0.0; 2];
        for step in data.split(['m', 'l', 'z', 'h']).filter(|step| !step.is_empty() && *step != "0") {
            let mut numbers: Vec<String> = Vec::new();
            for letter in step.chars() {
                match letter {
                    ' ' => numbers.push(String::new()),
                    '-' => numbers.push("-".into()),
                    other if numbers.is_empty() => numbers.push(other.to_string()),
                    other => numbers.last_mut().unwrap().push(other),
                }
            }
            for (axis, number) in numbers.iter().filter(|number| !number.is_empty()).enumerate() {
                pen[axis] += number.parse::<f64>().unwrap();
            }
            for axis in 0..2 {
                low[axis] = low[axis].min(pen[axis]);
                high[axis] = high[axis].max(pen[axis]);
            }
        }
    }
    (0..2).map(|axis| high[axis] - low[axis]).collect()
}

#[test]
fn a_direction_between_the_axes_is_a_side_of_its_own() {
    let desk = Desk::new();
    desk.write("can.glb", closed_can());
    let output = desk.isomark(&["inspect", "can.glb", "--facing", "1,-1,0", "--json"]);
    let facts: Value = serde_json::from_str(&output.out).unwrap();
    let sides = facts["sides"].as_array().unwrap();
    assert_eq!(sides.len(), 7);
    // A can looks alike from all directions round its axis.
    let (named, front) = (&sides[6], sides.iter().find(|side| side["side"] == "-y").unwrap());
    assert_eq!(named["side"], "0.7071,-0.7071,0.0000");
    assert!((number(named, "/area_mm2") / number(front, "/area_mm2") - 1.0).abs() < 0.03, "{named:#}");
    let text = desk.isomark(&["inspect", "can.glb", "--facing", "1,-1,0"]).out;
    assert!(text.contains("--facing=0.7071,-0.7071,0.0000 --place 0,55"), "{text}");
}

#[test]
fn the_sides_are_a_page_too() {
    let desk = Desk::new();
    // Windows does not allow < and > in the name of a file.
    let (name, heading) =
        if cfg!(windows) { ("a&b.glb", "a&amp;b.glb") } else { ("a<b>&.glb", "a&lt;b&gt;&amp;.glb") };
    desk.write(name, closed_can());
    desk.isomark(&["inspect", name, "--preview", "sides.html"]).refused(0, &[]);
    let page = desk.text("sides.html");
    assert!(page.contains(&format!("<h1>{heading}")) && !page.contains("<b>") && !page.contains("<script"));
    assert_eq!(page.matches("<th scope=\"row\">").count(), 6);
    assert!(page.contains("--facing=-y --place 0,55") && page.contains("<svg"));
    assert!(page.contains("default-src 'none'; style-src 'sha256-"));
    // A policy without inline styles also forbids attributes.
    assert!(!page.contains(" style="), "{}", page.len());
    desk.isomark(&["inspect", name, "--preview", "sides.png"]).refused(2, &[".svg", "an HTML page"]);
}
