//! `isomark plan`: times of a drawing on a belt by closed forms, and what a belt that is too fast needs.

use serde_json::Value;

use crate::desk::{Desk, assert_near, number};

/// Lines across a belt along x, 20 mm long, at these positions.
fn drawing(positions: &[f64]) -> String {
    let mut text =
        "0\nSECTION\n2\nHEADER\n9\n$INSUNITS\n70\n4\n0\nENDSEC\n0\nSECTION\n2\nENTITIES\n".to_owned();
    for x in positions {
        text += &format!("0\nLINE\n8\nMARK\n10\n{x:?}\n20\n-10\n11\n{x:?}\n21\n10\n");
    }
    text + "0\nENDSEC\n0\nEOF\n"
}

fn plan(desk: &Desk, options: &str) -> Value {
    let line = format!("plan drawing.dxf --json {options}");
    let arguments: Vec<&str> = line.split_whitespace().collect();
    let output = desk.isomark(&arguments);
    assert_eq!(output.code, 0, "{}", output.err);
    serde_json::from_str(&output.out).unwrap()
}

const LASER: &str =
    "--field 100,60 --marking-speed 1000 --jump-speed 5000 --jump-delay 1 --line-delay 0.5 --corner-delay 0";

#[test]
fn times_lead_and_products_are_those_of_the_formulas() {
    let desk = Desk::new();
    desk.write("drawing.dxf", drawing(&[0.0, 10.0, 20.0]));
    // The thesis, chapter 7: 10 cm/s and about 50 s from the scan to the drawing give 5 m.
    let found = plan(&desk, &format!("{LASER} --speed 100 --pitch 200 --correction-time 50"));
    let jumps = 2.0 * 20f64.hypot(10.0);
    assert_near(&[number(&found, "/marking_s"), number(&found, "/jump_s")], &[0.06, jumps / 5000.0], 1e-9);
    assert_near(&[number(&found, "/delay_s"), number(&found, "/lead_mm")], &[0.0035, 5000.0], 1e-9);
    assert_near(
        &[number(&found, "/corrections_at_once"), number(&found, "/products_per_s")],
        &[25.0, 0.5],
        1e-9,
    );
    assert_eq!((&found["fits"], &found["remedy"]), (&true.into(), &Value::Null));
    assert_eq!(found["sections"][0]["paths"], serde_json::json!([3, 2, 1]));
    // Against the belt, the other end is first.
    let back = plan(&desk, &format!("{LASER} --speed 100 --direction=-x"));
    assert_eq!(back["sections"][0]["paths"], serde_json::json!([1, 2, 3]));
}

#[test]
fn a_belt_that_outruns_the_laser_gets_the_number_to_change() {
    let desk = Desk::new();
    desk.write(
        "drawing.dxf",
        drawing(&[0.0; 1]).replace("0\nENDSEC\n0\nEOF\n", "")
            + &{
                let many: Vec<f64> = (1..200).map(|index| f64::from(index) * 1e-3).collect();
                drawing(&many).split_once("ENTITIES\n").unwrap().1.to_owned()
            },
    );
    let found = plan(&desk, &format!("{LASER} --speed 100"));
    assert_eq!(found["fits"], false);
    let fastest = number(&found, "/fastest_belt_mm_per_s");
    // The hindmost line is the last to leave.
    assert_near(&[fastest], &[100.199 / (200.0 * 0.0205 + 199.0 * 0.005)], 0.01);
    assert!(
        found["remedy"].as_str().unwrap().contains(&format!("{:.2} mm/s", (fastest * 100.0).floor() / 100.0))
    );
    assert_eq!(found["sections"].as_array().unwrap().len(), 6);
    let slower = plan(&desk, &format!("{LASER} --speed {}", fastest * 0.999));
    assert_eq!((&slower["fits"], slower["sections"].as_array().unwrap().len()), (&true.into(), 1));
    // Products that follow too closely.
    let close = plan(&desk, &format!("{LASER} --speed 10 --pitch 40"));
    assert_eq!(close["fits"], false);
    let least = number(&close, "/smallest_pitch_mm");
    assert!(
        close["remedy"]
            .as_str()
            .unwrap()
            .contains(&format!("{:.2} mm apart", (least * 100.0 - 1e-6).ceil() / 100.0))
    );
}

/// At 2000 mm/s, a line is in the field of 100 mm for 50 ms; at 200 mm/s, it takes 100.5 ms.
#[test]
fn a_line_that_no_laser_can_mark_in_time_is_not_divided_between_lasers() {
    let desk = Desk::new();
    for lines in [&[0.0][..], &[0.0, 1.0]] {
        desk.write("drawing.dxf", drawing(lines));
        let words = "plan drawing.dxf --field 100,60 --marking-speed 200 --line-delay 0.5 --corner-delay 0 --speed 2000";
        let words: Vec<&str> = words.split(' ').collect();
        let text = desk.isomark(&words).out;
        assert!(text.contains("one line takes 0.1005 s, and is in the field for 0.0500 s"), "{text}");
        assert!(!text.contains("lasers") && !text.contains("-0.0"), "{text}");
    }
}

#[test]
fn senseless_numbers_are_refused() {
    let desk = Desk::new();
    desk.write("drawing.dxf", drawing(&[0.0]));
    for options in [
        "--speed 0 --field 100,60",
        "--speed 100",
        "--speed 100 --field 100",
        "--speed 100 --field 100,60 --marking-speed 0",
        "--speed 100 --field 100,60 --jump-delay=-1",
        "--speed nan --field 100,60",
    ] {
        let line = format!("plan drawing.dxf {options}");
        let arguments: Vec<&str> = line.split_whitespace().collect();
        assert!(desk.isomark(&arguments).code != 0, "{options}");
    }
    for option in ["--speed", "--marking-speed", "--jump-delay", "--pitch"] {
        let words = ["plan", "drawing.dxf", "--speed", "100", option, "-100"];
        let words: Vec<&str> = if option == "--speed" {
            words[..2].iter().chain(&words[4..]).copied().collect()
        } else {
            words.to_vec()
        };
        desk.isomark(&words).refused(2, &[&format!("'-100' for '{option}"), "give a number"]);
    }
    desk.isomark(&["plan", "drawing.dxf", "--speed", "100", "--field", "100,15"])
        .refused(1, &["20", "15", "across"]);
}

#[test]
fn marks_of_neighbouring_products_do_not_overlap() {
    let desk = Desk::new();
    desk.write("drawing.dxf", drawing(&[0.0, 10.0, 20.0]));
    // The drawing is 20 mm long.
    let found = plan(&desk, &format!("{LASER} --speed 10 --pitch 15"));
    assert!(number(&found, "/smallest_pitch_mm") >= 20.0, "{found}");
    assert_eq!(found["fits"], false);
}

#[test]
fn a_drawing_in_tiles_is_not_planned_as_one_pass() {
    let desk = Desk::new();
    desk.write("drawing.dxf", drawing(&[0.0, 10.0]).replace("MARK", "R+045.000 MARK"));
    let line = format!("plan drawing.dxf {LASER} --speed 10");
    desk.isomark(&line.split_whitespace().collect::<Vec<_>>())
        .refused(1, &["R+045.000 MARK", "--tiles-as files"]);
}

/// With products one after the other, the time for each is its pitch divided by the speed of the belt; and every remedy works as it
/// is printed.
#[test]
fn a_remedy_for_products_at_a_pitch_works_as_it_is_printed() {
    let desk = Desk::new();
    // 200 lines of 20 mm on 20 mm along the belt take 200 · 20.5 ms and 199 jumps of about 20 mm and 1 ms each, 5.095 s.
    let positions: Vec<f64> = (0..200).map(|index| f64::from(index) * 20.0 / 199.0).collect();
    desk.write("drawing.dxf", drawing(&positions));
    let numbers_of = |remedy: &str| -> Vec<String> {
        let number = |word: &str| word.trim_end_matches(',').parse::<f64>().is_ok();
        remedy
            .split(' ')
            .filter(|word| number(word))
            .map(|word| word.trim_end_matches(',').to_owned())
            .collect()
    };
    let at = |speed: &str, pitch: &str| plan(&desk, &format!("{LASER} --speed {speed} --pitch {pitch}"));
    let found = at("200", "45");
    assert_eq!(found["fits"], false, "{found:#}");
    let remedy = found["remedy"].as_str().unwrap();
    let fastest = number(&found, "/fastest_belt_mm_per_s");
    // A belt that moves by the pitch while the product is marked.
    assert!((fastest * number(&found, "/total_s") / 45.0 - 1.0).abs() < 1e-3, "{found:#}");
    assert!(remedy.starts_with("Slow the belt to at most 8.8"), "{remedy}");
    assert_eq!(at(&numbers_of(remedy)[0], "45")["fits"], true, "{remedy}");
    // On a belt that passes the laser in time, but brings the next product too early.
    let found = at("15", "45");
    let remedy = found["remedy"].as_str().unwrap();
    let [speed, pitch, ..] = &numbers_of(remedy)[..] else { panic!("{remedy}") };
    assert_eq!(
        (&at(speed, "45")["fits"], &at("15", pitch)["fits"]),
        (&true.into(), &true.into()),
        "{remedy}"
    );
    // Products of 20 mm cannot be 10 mm apart, on any belt.
    for speed in ["5", "200"] {
        let found = at(speed, "10");
        assert!(found.get("fastest_belt_mm_per_s").is_none(), "{found:#}");
        let remedy = found["remedy"].as_str().unwrap();
        assert!(remedy.contains("each is 20.00 mm long"), "{remedy}");
        let numbers = numbers_of(remedy);
        let slower = if remedy.contains("slow the belt") { &numbers[1] } else { speed };
        assert_eq!(at(slower, &numbers[0])["fits"], true, "{remedy}");
    }
}
