//! A new station with a perspective lens, from `init` to a true mark: a simulated laser marks the drawings that the program
//! writes, and a simulated person with a ruler measures the plates.

use std::fmt::Write as _;

use isomark::formats::pattern::{PatternOptions, read};
use nalgebra::{Point2, Point3, Rotation2, Vector2};
use serde_json::Value;

use crate::desk::{Desk, Output, assert_near, notices, number};

/// The simulated laser: distances to the two mirrors, and the axis, in a field of 200 × 160 mm with its zero at a corner.
const DISTANCES: [f64; 2] = [300.0, 285.0];
const AXIS: [f64; 2] = [103.0, 78.0];

const FIELD: &str = "[field]\nwidth_mm = 200\nheight_mm = 160\norigin = \"corner\"\n";

fn settings() -> String {
    format!(
        "# A new laser.\n[station]\nname = \"Laser 7\"\n[folders]\nhot = \"hot\"\nimport = \"import\"\n{FIELD}\
             [optics]\n# Not measured yet.\nkind = \"telecentric\"   # for now\nfocus_depth_mm = 60\n"
    )
}

/// Where the beam that is aimed at a point of the field is at height `z`.
fn beam(aim: Point2<f64>, z: f64) -> Point3<f64> {
    let beside = aim - Point2::from(AXIS);
    Point3::new(
        AXIS[0] + beside.x * (1.0 - z / DISTANCES[0]),
        AXIS[1] + beside.y * (1.0 - z / DISTANCES[1]),
        z,
    )
}

/// Normally distributed numbers with a standard deviation of 1, from a fixed sequence.
struct Noise(u64);

impl Noise {
    fn next(&mut self) -> f64 {
        let mut uniform = || {
            self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            ((self.0 >> 11) as f64 + 0.5) / (1u64 << 53) as f64
        };
        let (radius, angle) = (uniform(), uniform() * std::f64::consts::TAU);
        (-2.0 * radius.ln()).sqrt() * angle.cos()
    }
}

/// The lines of a drawing on a layer, as its ends.
fn lines(dxf: &[u8], layer: &str) -> Vec<[Point2<f64>; 2]> {
    let drawing = read(dxf, &PatternOptions::default().strictly(true)).unwrap().pattern;
    let on_layer = drawing.paths.iter().filter(|path| drawing.layers[path.layer].name == layer);
    let ends = |path: &isomark::geometry::pattern::Path| {
        let segments = path.shape.segments();
        [segments[0].start(), segments[segments.len() - 1].end()].map(|at| Point2::from(at.coords()))
    };
    on_layer.map(ends).collect()
}

/// The filled-in table of positions: each plate is turned and shifted under the ruler, unless stops hold it.
fn measured(table: &str, noise: &mut Noise, deviation: f64, stops: bool) -> String {
    let mut filled = String::new();
    for line in table.lines() {
        let cells: Vec<&str> = line.split(';').collect();
        let [name, z, x, y, "", ""] = cells[..] else {
            filled += &format!("{line}\n");
            continue;
        };
        let [z, x, y] = [z, x, y].map(|cell| cell.parse::<f64>().unwrap());
        let (turn, shift) = if stops || z == 0.0 { (0.012, [4.0, 3.0]) } else { (-0.02, [-6.0, 9.0]) };
        let at = Rotation2::new(turn) * beam(Point2::new(x, y), z).coords.xy() + Vector2::from(shift);
        let [x_seen, y_seen] = [at.x, at.y].map(|value| value + deviation * noise.next());
        // A German spreadsheet.
        writeln!(filled, "{name};{z};{x};{y};{x_seen:.3};{y_seen:.3}").unwrap();
    }
    filled.replace('.', ",")
}

/// A desk with a station and the empty tables.
fn desk() -> Desk {
    let desk = Desk::new();
    desk.write("station.toml", settings());
    let output = calibrate(&desk, "--draw lens");
    assert_eq!(output.code, 0, "{}", output.err);
    desk
}

fn calibrate(desk: &Desk, options: &str) -> Output {
    let arguments: Vec<&str> =
        ["calibrate", "lens", "station.toml"].into_iter().chain(options.split_whitespace()).collect();
    desk.isomark(&arguments)
}

fn result(desk: &Desk, options: &str) -> Value {
    let output = calibrate(desk, &format!("{options} --json"));
    assert_eq!(output.code, 0, "{}", output.err);
    serde_json::from_str(&output.out).unwrap()
}

#[test]
fn the_test_drawings_have_named_crosses_inside_the_field_and_tables_for_them() {
    let desk = desk();
    for (file, height) in [("lens/lens-z0.dxf", 0.0), ("lens/lens-z30.dxf", 30.0)] {
        let bytes = desk.read(file);
        let crosses = lines(&bytes, "CROSSES");
        assert_eq!(crosses.len(), 18, "two arms for each cross");
        let labels = lines(&bytes, "LABELS");
        assert!(labels.len() > 9);
        for end in crosses.iter().chain(&labels).flatten() {
            assert!(
                (0.0..=200.0).contains(&end.x) && (0.0..=160.0).contains(&end.y),
                "{end} is outside the field"
            );
        }
        let table = desk.text("lens/lens-positions.csv");
        let rows = table.lines().filter(|line| line.contains(&format!(";{height};")));
        for row in rows {
            let [x, y] = [2, 3].map(|cell| row.split(';').nth(cell).unwrap().parse::<f64>().unwrap());
            let through =
                |[from, to]: &[Point2<f64>; 2]| ((from + to.coords) / 2.0 - Point2::new(x, y)).norm() < 1e-6;
            assert_eq!(crosses.iter().filter(|line| through(line)).count(), 2, "{row}");
        }
    }
    assert_eq!(desk.text("lens/lens-distances.csv").lines().count(), 2 + 2 * 8);
    // A table that may contain measurements is kept.
    desk.write("lens/lens-positions.csv", "cross;height_mm\n");
    calibrate(&desk, "--draw lens").refused(2, &["may contain measurements"]);
    calibrate(&desk, "--draw other --heights 5").refused(2, &["two or more heights"]);
    calibrate(&desk, "").refused(2, &["No measurements are given", "--draw lens-test"]);
}

#[test]
fn a_new_station_gets_its_lens_and_marks_true() {
    let desk = desk();
    let table = measured(&desk.text("lens/lens-positions.csv"), &mut Noise(11), 0.02, true);
    desk.write("lens/lens-positions.csv", table);
    let found =
        result(&desk, "--measured lens/lens-positions.csv --stops --picture lens/residuals.svg --write");
    for axis in 0..2 {
        let [distance, deviation] =
            ["value", "deviation"].map(|key| number(&found, &format!("/lens_distances_mm/{axis}/{key}")));
        assert!((distance / DISTANCES[axis] - 1.0).abs() < 0.005 && deviation < 1.0, "{found:#}");
        let [place, deviation] =
            ["value", "deviation"].map(|key| number(&found, &format!("/axis_mm/{axis}/{key}")));
        assert!((place - AXIS[axis]).abs() < 2.0 && deviation < 3.0, "{found:#}");
    }
    assert!((0.01..0.03).contains(&number(&found, "/reading_mm")));
    assert!(notices(&found).is_empty(), "{found:#}");
    assert_near(&[number(&found, "/plates/0/turned_deg")], &[0.012f64.to_degrees()], 0.03);
    let picture = desk.text("lens/residuals.svg");
    assert!(picture.contains("plate at 30 mm") && picture.contains(">C3<"), "{picture}");
    // The comments of the settings stay.
    let station = desk.text("station.toml");
    assert!(
        station.contains("# A new laser.")
            && station.contains("# Not measured yet.\nkind = \"perspective\"   # for now"),
        "{station}"
    );
    desk.write("import/.keep", "");
    assert_eq!(desk.isomark(&["check", "station.toml"]).code, 0);
    // A square on a raised plate becomes a square. The axis is known to about 1 mm, so its place may be 0.1 mm off.
    desk.write("plate.obj", "v 60 40 25\nv 140 40 25\nv 140 120 25\nv 60 120 25\nf 1 2 3\nf 1 3 4\n");
    desk.write("square.dxf", SQUARE);
    desk.correct("plate.obj", "square.dxf", "--station station.toml --part-unit mm --part-up z");
    let marked: Vec<_> = lines(&desk.read("out.dxf"), "0").concat();
    let corners: Vec<_> = marked.iter().map(|aim| beam(*aim, 25.0).xy()).collect();
    for (found, drawn) in corners.iter().zip([[70.0, 50.0], [130.0, 50.0], [70.0, 110.0], [130.0, 110.0]]) {
        assert!((found - Point2::from(drawn)).norm() < 0.15, "{found} for {drawn:?}");
    }
    let width = (corners[1] - corners[0]).norm();
    assert!((width - 60.0).abs() < 0.03, "{width}");
}

/// Runs every command of the section for a new lens in the guide, on a simulated laser.
#[test]
fn the_commands_of_the_guide_lead_from_a_new_station_to_a_true_mark() {
    let guide = include_str!("../../plugins/beamconstruct/README.md");
    let section = guide.split("## A new lens").nth(1).unwrap().split("\n## ").next().unwrap();
    let commands: Vec<&str> = section.lines().filter_map(|line| line.strip_prefix("isomark ")).collect();
    assert_eq!(commands.len(), 7);
    // The laser of the guide, and where its box stands: turned by 12 deg.
    let beam = |aim: Point2<f64>, z: f64| {
        Point2::new(1.0 + (aim.x - 1.0) * (1.0 - z / 300.0), -1.5 + (aim.y + 1.5) * (1.0 - z / 285.0))
    };
    let desk = Desk::new();
    let mut box_obj = String::new();
    for z in [0, 20] {
        box_obj += &format!("v -25 -15 {z}\nv 25 -15 {z}\nv 25 15 {z}\nv -25 15 {z}\n");
    }
    desk.write("box.obj", box_obj + "f 4 3 2 1\nf 5 6 7 8\nf 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\nf 4 1 5 8\n");
    desk.write(
        "square.dxf",
        "0\nSECTION\n2\nHEADER\n9\n$INSUNITS\n70\n4\n0\nENDSEC\n0\nSECTION\n2\nENTITIES\n\
         0\nLINE\n8\n0\n10\n-10\n20\n-10\n11\n10\n21\n-10\n0\nLINE\n8\n0\n10\n-10\n20\n10\n11\n10\n21\n10\n0\nENDSEC\n0\nEOF\n",
    );
    let mut noise = Noise(21);
    for command in commands {
        if command.contains("--measured") {
            let table = desk.text("lens-test/lens-positions.csv");
            let filled = table.lines().map(|line| {
                let cells: Vec<&str> = line.split(';').collect();
                let [name, z, x, y, "", ""] = cells[..] else { return format!("{line}\n") };
                let [z_mm, x_mm, y_mm] = [z, x, y].map(|cell| cell.parse::<f64>().unwrap());
                let seen = beam(Point2::new(x_mm, y_mm), z_mm).coords + Vector2::new(60.0, 58.0);
                let [seen_x, seen_y] = [seen.x, seen.y].map(|value| value + 0.01 * noise.next());
                format!("{name};{z};{x};{y};{seen_x:.2};{seen_y:.2}\n")
            });
            let filled: String = filled.collect();
            desk.write("lens-test/lens-positions.csv", filled);
        }
        let arguments: Vec<&str> = command.split_whitespace().collect();
        let output = desk.isomark(&arguments);
        assert_eq!(output.code, 0, "isomark {command}: {}", output.err);
    }
    let turn = Rotation2::new(12f64.to_radians());
    let marked = lines(&desk.read("square-bent.dxf"), "0").concat();
    let corners: Vec<_> = marked.iter().map(|aim| beam(*aim, 20.0)).collect();
    for (corner, drawn) in corners.iter().zip([[-10.0, -10.0], [10.0, -10.0], [-10.0, 10.0], [10.0, 10.0]]) {
        let truth = turn * Point2::from(drawn) + Vector2::new(6.0, -4.0);
        assert!((corner - truth).norm() < 0.1, "{corner} for {truth}");
    }
    assert!(((corners[1] - corners[0]).norm() - 20.0).abs() < 0.02);
}

/// Four lines round 60 × 60 mm.
const SQUARE: &str = "0\nSECTION\n2\nHEADER\n9\n$INSUNITS\n70\n4\n0\nENDSEC\n0\nSECTION\n2\nENTITIES\n\
0\nLINE\n8\n0\n10\n70\n20\n50\n11\n130\n21\n50\n0\nLINE\n8\n0\n10\n70\n20\n110\n11\n130\n21\n110\n0\nENDSEC\n0\nEOF\n";

#[test]
fn two_heights_and_nine_crosses_give_both_distances_to_half_a_percent() {
    let desk = desk();
    let table = desk.text("lens/lens-positions.csv");
    for seed in 0..8 {
        desk.write("measured.csv", measured(&table, &mut Noise(100 + seed), 0.02, false));
        let found = result(&desk, "--measured measured.csv");
        for axis in 0..2 {
            let distance = number(&found, &format!("/lens_distances_mm/{axis}/value"));
            assert!((distance / DISTANCES[axis] - 1.0).abs() < 0.005, "seed {seed}: {distance}");
        }
        assert!(found.get("axis_mm").is_none());
        assert_eq!(notices(&found), ["axis-not-measured"]);
    }
}

#[test]
fn one_value_that_is_wrong_by_5_mm_is_named() {
    let desk = desk();
    let table = measured(&desk.text("lens/lens-positions.csv"), &mut Noise(3), 0.02, false);
    let row = table.lines().find(|line| line.starts_with("B3;30;")).unwrap();
    let cells: Vec<&str> = row.split(';').collect();
    let wrong = format!("{:.3}", cells[4].replace(',', ".").parse::<f64>().unwrap() + 5.0).replace('.', ",");
    desk.write("measured.csv", table.replace(row, &row.replace(cells[4], &wrong)));
    let found = result(&desk, "--measured measured.csv");
    assert_eq!(notices(&found), ["measurement-contradicts", "axis-not-measured"]);
    let message = found["notices"][0]["message"].as_str().unwrap();
    assert!(
        message.starts_with("x of cross B3 on the plate at 30 mm") && message.contains("difference of +5.0"),
        "{message}"
    );
    assert!((number(&found, "/lens_distances_mm/0/value") / 300.0 - 1.0).abs() < 0.005);
    let text = calibrate(&desk, "--measured measured.csv").out;
    assert!(text.contains("left out") && text.contains("[optics]\nkind = \"perspective\""), "{text}");
}

#[test]
fn distances_on_the_command_line_are_enough() {
    let desk = desk();
    let distance = |z: f64, [from, to]: [[f64; 2]; 2]| {
        let [from, to] = [from, to].map(|at| beam(at.into(), z));
        (to - from).norm()
    };
    let (a1, c1, a3) = ([20.0, 16.0], [180.0, 16.0], [20.0, 144.0]);
    let mut arguments: Vec<String> = ["calibrate", "lens", "station.toml", "--json"].map(String::from).into();
    for z in [0.0, 30.0] {
        for (names, ends) in [("A1 C1", [a1, c1]), ("a1 a3", [a1, a3])] {
            arguments.extend(["--distance".into(), format!("{z} {names} {:.3}", distance(z, ends))]);
        }
    }
    let output = desk.isomark(&arguments);
    let found: Value = serde_json::from_str(&output.out).unwrap();
    assert_near(
        &[0, 1].map(|axis| number(&found, &format!("/lens_distances_mm/{axis}/value"))),
        &DISTANCES,
        0.2,
    );
    // Four values leave nothing to check them with: the uncertainty is that of the ruler.
    assert_eq!((number(&found, "/spare"), number(&found, "/reading_mm")), (0.0, 0.1));
    calibrate(&desk, "--distance 30").refused(2, &["does not have four parts"]);
    desk.isomark(&["calibrate", "lens", "station.toml", "--distance", "30 A1 D9 1"])
        .refused(2, &["no cross `D9`"]);
}

#[test]
fn tables_that_cannot_be_right_are_refused_with_what_to_do() {
    let desk = desk();
    let table = measured(&desk.text("lens/lens-positions.csv"), &mut Noise(4), 0.02, false);
    let each = |change: &dyn Fn(&mut Vec<String>)| {
        let lines = table.lines().map(|line| {
            let mut cells: Vec<String> = line.split(';').map(str::to_owned).collect();
            if cells.len() == 6 && cells[0].len() == 2 {
                change(&mut cells);
            }
            cells.join(";")
        });
        lines.collect::<Vec<_>>().join("\n")
    };
    let cases: [(String, i32, &[&str]); 7] = [
        (
            each(&|cells| cells.swap(4, 5)),
            1,
            &["y seem swapped on the plate at 0 mm", "Exchange the columns"],
        ),
        (each(&|cells| cells[5] = format!("-{}", cells[5])), 1, &["sign of y seems wrong"]),
        (
            each(&|cells| {
                if cells[1] == "30" {
                    cells[1] = "-30".into()
                }
            }),
            1,
            &["marks become larger", "height_mm", "number:     growth"],
        ),
        (
            each(&|cells| {
                if cells[0] != "A1" {
                    cells[4].clear()
                }
            }),
            1,
            &["do not determine the lens", "three crosses"],
        ),
        (
            each(&|cells| {
                if cells[1] == "30" {
                    cells[4].clear();
                    cells[5].clear()
                }
            }),
            1,
            &["at one height"],
        ),
        // The table as it is written.
        (
            each(&|cells| {
                cells[4].clear();
                cells[5].clear()
            }),
            1,
            &["Nothing is measured", "fill in the columns"],
        ),
        (
            each(&|cells| {
                if cells[0] == "B2" {
                    cells[4] = "7o".into()
                }
            }),
            1,
            &["`7o` is not a number", "line 7", "column measured_x_mm"],
        ),
    ];
    for (text, code, words) in cases {
        desk.write("measured.csv", text);
        calibrate(&desk, "--measured measured.csv").refused(code, words);
        calibrate(&desk, "--measured measured.csv --json --write");
        assert_eq!(desk.text("station.toml"), settings(), "the settings are kept");
    }
    calibrate(&desk, "--measured none.csv").refused(3, &["none.csv"]);
    calibrate(&desk, "--measured measured.csv --picture measured.csv").refused(2, &["would be lost"]);
}

#[test]
fn stops_that_the_plates_do_not_share_are_refused() {
    let desk = desk();
    let table = desk.text("lens/lens-positions.csv");
    let settings = desk.text("station.toml");
    let refused = |measured: String, words: &str| {
        desk.write("measured.csv", measured);
        let found = calibrate(&desk, "--measured measured.csv --stops --write");
        found.refused(1, &["stops-not-shared", words, "leave out `--stops`"]);
        assert_eq!(desk.text("station.toml"), settings);
    };
    refused(measured(&table, &mut Noise(3), 0.02, false), "turned against each other by 1.83 deg");
    // Without a turn, a shift of 20 mm between the plates moves the axis by 20 / 0.1 = 200 mm.
    let shared = measured(&table, &mut Noise(3), 0.02, true);
    let rows: Vec<Vec<String>> =
        shared.replace(',', ".").lines().map(|line| line.split(';').map(str::to_owned).collect()).collect();
    let is_raised = |cells: &[String]| cells.get(1).is_some_and(|height| height == "30");
    let joined = |rows: &[Vec<String>]| rows.iter().map(|cells| cells.join(";") + "\n").collect::<String>();
    let moved = |shift: f64| {
        let mut moved = rows.clone();
        for cells in moved.iter_mut().filter(|cells| is_raised(cells)) {
            cells[4] = (cells[4].parse::<f64>().unwrap() + shift).to_string();
        }
        joined(&moved)
    };
    refused(moved(20.0), "outside the field");
    // A tenth of that leaves the axis in the field.
    desk.write("measured.csv", moved(2.0));
    let found = result(&desk, "--measured measured.csv --stops");
    assert_eq!(notices(&found), ["axis-off-middle"]);
    let message = found["notices"][0]["message"].as_str().unwrap();
    let slip: f64 = message.split_once("that was ").unwrap().1.split(' ').next().unwrap().parse().unwrap();
    // The axis itself is 3.6 mm off the middle, as a slip of 0.4 mm would make it.
    assert!((slip - 2.0).abs() < 0.5, "{message}");
    // Positions on the lower plate, and only distances on the raised one.
    let (raised, lower): (Vec<_>, Vec<_>) = rows.into_iter().partition(|cells| is_raised(cells));
    let at = |name: &str| {
        let cells = raised.iter().find(|cells| cells[0] == name).unwrap();
        Point2::from([4, 5].map(|cell| cells[cell].parse::<f64>().unwrap()))
    };
    let distance = |(from, to): (&str, &str)| format!("30 {from} {to} {:.3}", (at(from) - at(to)).norm());
    let distances = [("A1", "C1"), ("A3", "C3"), ("A1", "A3"), ("C1", "C3")].map(distance);
    desk.write("measured.csv", joined(&lower));
    let mut arguments = vec!["calibrate", "lens", "station.toml", "--measured", "measured.csv", "--stops"];
    arguments.extend(distances.iter().flat_map(|typed| ["--distance", typed]));
    desk.isomark(&arguments).refused(1, &["stops-not-shared", "measured on fewer than two plates (1)"]);
    arguments.retain(|argument| *argument != "--stops");
    assert_eq!(desk.isomark(&arguments).code, 0);
}

#[test]
fn a_lens_table_from_the_measurements_describes_the_same_lens() {
    let desk = desk();
    let table = measured(&desk.text("lens/lens-positions.csv"), &mut Noise(5), 0.01, true);
    desk.write("measured.csv", table);
    result(&desk, "--measured measured.csv --stops --table lens/lens.csv --write");
    let station = desk.text("station.toml");
    assert!(station.contains("table = \"lens/lens.csv\"") && !station.contains("kind"), "{station}");
    desk.write("plate.obj", "v 60 40 25\nv 140 40 25\nv 140 120 25\nv 60 120 25\nf 1 2 3\nf 1 3 4\n");
    desk.write("square.dxf", SQUARE);
    desk.correct("plate.obj", "square.dxf", "--station station.toml --part-unit mm --part-up z");
    let marked: Vec<_> = lines(&desk.read("out.dxf"), "0").concat();
    let width = (beam(marked[1], 25.0) - beam(marked[0], 25.0)).norm();
    assert!((width - 60.0).abs() < 0.05, "{width}");
}

/// The filled-in table of positions, without noise, of a laser that marks at `seen`.
fn filled(table: &str, seen: impl Fn(Point2<f64>, f64) -> Point2<f64>) -> String {
    let lines = table.lines().map(|line| {
        let cells: Vec<&str> = line.split(';').collect();
        let [name, z, x, y, "", ""] = cells[..] else { return format!("{line}\n") };
        let [z_mm, x_mm, y_mm] = [z, x, y].map(|cell| cell.parse::<f64>().unwrap());
        let at = seen(Point2::new(x_mm, y_mm), z_mm);
        format!("{name};{z};{x};{y};{:.4};{:.4}\n", at.x, at.y)
    });
    lines.collect()
}

/// A lens with a distortion of 0.8 mm at 80 mm from its axis, growing with the third power: three crosses along each side do not
/// show it, five do.
#[test]
fn a_lens_table_states_how_well_its_beams_are_known() {
    let lens = |aim: Point2<f64>, z: f64| {
        let beside = (aim - Point2::from(AXIS)) / 80.0;
        beam(aim, z).xy() + beside * beside.norm_squared() * 0.8
    };
    for (crosses, is_known) in [("3", false), ("5", true)] {
        let desk = Desk::new();
        desk.write("station.toml", settings());
        assert_eq!(calibrate(&desk, &format!("--draw lens --crosses {crosses}")).code, 0);
        let table = desk.text("lens/lens-positions.csv");
        desk.write("measured.csv", filled(&table, lens));
        let options = "--measured measured.csv --stops --reading 1 --table lens/lens.csv --write";
        let found = result(&desk, options);
        let predicted = number(&found, "/lens_table/prediction_rms_mm");
        assert_eq!((predicted < 0.01, predicted > 0.1), (is_known, !is_known), "{found:#}");
        let warned = |codes: &[&str]| codes.contains(&"lens-table-residual");
        assert_eq!(warned(&notices(&found)), !is_known, "{found:#}");
        desk.write("import/.keep", "");
        let checked = desk.isomark(&["check", "station.toml"]);
        assert_eq!(checked.code, 0, "{}", checked.err);
        assert!(checked.out.contains("  lens table  degree "), "{}", checked.out);
        assert_eq!(checked.out.contains("lens-table-residual"), !is_known, "{}", checked.out);
        desk.write("plate.obj", "v 60 40 0\nv 180 40 0\nv 180 120 0\nv 60 120 0\nf 1 2 3\nf 1 3 4\n");
        desk.write("square.dxf", SQUARE.replace("130", "170"));
        let report =
            desk.correct("plate.obj", "square.dxf", "--station station.toml --part-unit mm --part-up z");
        assert_eq!(warned(&notices(&report)), !is_known, "{report:#}");
        assert!((number(&report, "/lens_table/prediction_rms_mm") - predicted).abs() < 1e-9);
        // What the laser marks: the report's own error is that of the table.
        let marked: Vec<_> = lines(&desk.read("out.dxf"), "0").concat();
        let off = ((lens(marked[1], 0.0) - lens(marked[0], 0.0)).norm() - 100.0).abs();
        assert_eq!((off < 0.01, off > 0.1), (is_known, !is_known), "{off} mm of length");
    }
}

/// The table compensates for the scale of the field, so that a correction in the marking software would be the second one.
#[test]
fn a_scale_of_the_field_is_corrected_in_one_place() {
    let desk = desk();
    let lens = |aim: Point2<f64>, z: f64| Point2::from(beam(aim, z).xy().coords * 1.01);
    desk.write("measured.csv", filled(&desk.text("lens/lens-positions.csv"), lens));
    let advice = |found: &Value| {
        assert_eq!(notices(found)[..2], ["field-scale", "field-scale"], "{found:#}");
        found["notices"][0]["message"].as_str().unwrap().to_owned()
    };
    let message = advice(&result(&desk, "--measured measured.csv --stops"));
    assert!(message.contains("correct the scale in the marking software's calibration"), "{message}");
    let message = advice(&result(&desk, "--measured measured.csv --stops --table lens/lens.csv --write"));
    assert!(message.contains("leave the scale") && !message.contains("correct the scale"), "{message}");
    desk.write("plate.obj", "v 60 40 25\nv 140 40 25\nv 140 120 25\nv 60 120 25\nf 1 2 3\nf 1 3 4\n");
    desk.write("square.dxf", SQUARE);
    desk.correct("plate.obj", "square.dxf", "--station station.toml --part-unit mm --part-up z");
    let marked: Vec<_> = lines(&desk.read("out.dxf"), "0").concat();
    let width = (lens(marked[1], 25.0) - lens(marked[0], 25.0)).norm();
    assert!((width - 60.0).abs() < 0.01, "{width}");
}

#[test]
fn readings_in_another_unit_are_refused() {
    let desk = desk();
    let table = desk.text("lens/lens-positions.csv");
    for (factor, unit) in [(1.0 / 25.4, "in inches"), (0.1, "in cm"), (10.0, "in tenths of a mm")] {
        desk.write("measured.csv", filled(&table, |aim, z| Point2::from(beam(aim, z).xy().coords * factor)));
        calibrate(&desk, "--measured measured.csv").refused(1, &["measurements-unit", unit, "in mm"]);
    }
}

/// A lens whose beams are steeper towards the rim: by this share more for each mm² from the axis.
fn pupil(share: f64) -> impl Fn(Point2<f64>, f64) -> Point2<f64> {
    move |aim, z| {
        let beside = aim - Point2::from(AXIS);
        let steeper = 1.0 + share * beside.norm_squared();
        aim - Vector2::new(beside.x / DISTANCES[0], beside.y / DISTANCES[1]) * steeper * z
    }
}

#[test]
fn a_lens_that_two_distances_do_not_describe_is_a_warning_and_has_a_table() {
    let desk = desk();
    desk.write("measured.csv", filled(&desk.text("lens/lens-positions.csv"), pupil(5e-6)));
    let found = result(&desk, "--measured measured.csv --stops --reading 0.02");
    assert_eq!(notices(&found), ["lens-residual"]);
    let message = found["notices"][0]["message"].as_str().unwrap();
    assert!(message.contains("--crosses 5") && message.contains("--table"), "{message}");
    // So far from two distances that they contradict all values; the table has them.
    let desk = Desk::new();
    desk.write("station.toml", settings());
    assert_eq!(calibrate(&desk, "--draw lens --crosses 5").code, 0);
    let lens = pupil(3e-5);
    desk.write("measured.csv", filled(&desk.text("lens/lens-positions.csv"), &lens));
    let options = "--measured measured.csv --stops --reading 0.02";
    calibrate(&desk, options).refused(1, &["measurement-contradicts", "--crosses 5", "--table"]);
    let found = result(&desk, &format!("{options} --table lens/lens.csv --write"));
    assert!(!notices(&found).contains(&"measurement-contradicts"), "{found:#}");
    desk.write("plate.obj", "v 60 40 15\nv 140 40 15\nv 140 120 15\nv 60 120 15\nf 1 2 3\nf 1 3 4\n");
    desk.write("square.dxf", SQUARE);
    desk.correct("plate.obj", "square.dxf", "--station station.toml --part-unit mm --part-up z");
    let marked: Vec<_> = lines(&desk.read("out.dxf"), "0").concat();
    for (aim, drawn) in marked.iter().zip([[70.0, 50.0], [130.0, 50.0], [70.0, 110.0], [130.0, 110.0]]) {
        let found = lens(*aim, 15.0);
        assert!((found - Point2::from(drawn)).norm() < 0.02, "{found} for {drawn:?}");
    }
    // One value that is wrong by 5 mm is still found.
    let table = desk.text("measured.csv");
    let row = table.lines().find(|line| line.starts_with("B3;30;")).unwrap();
    let cells: Vec<&str> = row.split(';').collect();
    let wrong = format!("{:.4}", cells[4].parse::<f64>().unwrap() + 5.0);
    desk.write("measured.csv", table.replace(row, &row.replace(cells[4], &wrong)));
    calibrate(&desk, &format!("{options} --table lens/lens.csv")).refused(1, &["measurement-contradicts"]);
}

#[test]
fn lenses_that_no_scan_head_has_are_refused_with_their_likely_cause() {
    let desk = desk();
    let table = desk.text("lens/lens-positions.csv");
    let truth = |aim: Point2<f64>, z: f64| beam(aim, z).xy();
    let exact = filled(&table, truth);
    let refused = |text: &str, words: &[&str]| {
        desk.write("measured.csv", text);
        calibrate(&desk, "--measured measured.csv").refused(1, words);
    };
    // 3 typed for 30, in all rows and in one.
    refused(&exact.replace(";30;", ";3;"), &["30.0 and 28.5 mm", "no scan head", "height_mm"]);
    refused(
        &exact.replace("B2;30;", "B2;3;"),
        &["At a height of 3 mm there is only the cross B2", "height_mm"],
    );
    // Inches on the higher plate, and on the lower one.
    for (inches, place) in [(30.0, "On the plate at 30 mm"), (0.0, "On the calibrated plane")] {
        let seen = |aim: Point2<f64>, z: f64| {
            Point2::from(truth(aim, z).coords / if z == inches { 25.4 } else { 1.0 })
        };
        refused(&filled(&table, seen), &["measurements-unit", place, "in inches"]);
    }
    // Plates that are nearly at one height show a lens poorly, and a telecentric one not at all.
    let near = |aim: Point2<f64>, z: f64| truth(aim, z / 60.0);
    let low = |text: String| text.replace(";30;", ";0.5;");
    desk.write("measured.csv", low(filled(&table, near)));
    let found = result(&desk, "--measured measured.csv --reading 0.001");
    assert_eq!(notices(&found), ["lens-uncertain", "axis-not-measured"]);
    let message = found["notices"][0]["message"].as_str().unwrap();
    assert!(message.contains("plates are only 0.5 mm apart"), "{message}");
    let mut noise = Noise(4);
    let mut off = || 0.1 * noise.next();
    let lines: Vec<String> = low(filled(&table, |aim, _| aim))
        .lines()
        .map(|line| match line.rsplit_once(';').and_then(|(rest, y)| Some((rest, y.parse::<f64>().ok()?))) {
            Some((rest, y)) => format!("{rest};{:.4}\n", y + off()),
            None => format!("{line}\n"),
        })
        .collect();
    refused(
        &lines.concat(),
        &["lens-not-determined", "whether the lens is telecentric", "only 0.5 mm apart"],
    );
}

#[test]
fn the_tilt_of_a_telecentric_lens_is_reported_and_kept_in_the_table() {
    let desk = desk();
    let lens = |aim: Point2<f64>, z: f64| aim + Vector2::new(0.02, -0.01) * z;
    desk.write("measured.csv", filled(&desk.text("lens/lens-positions.csv"), lens));
    let found = result(&desk, "--measured measured.csv --stops");
    assert_eq!((notices(&found), &found["telecentric"]), (vec!["beams-tilted"], &true.into()));
    let message = found["notices"][0]["message"].as_str().unwrap();
    assert!(message.contains("(+0.60, -0.30) mm"), "{message}");
    assert_near(&[number(&found, "/beam_tilt_deg/0/value")], &[0.02f64.atan().to_degrees()], 1e-3);
    result(&desk, "--measured measured.csv --stops --table lens/lens.csv --write");
    desk.write("plate.obj", "v 60 40 25\nv 140 40 25\nv 140 120 25\nv 60 120 25\nf 1 2 3\nf 1 3 4\n");
    desk.write("square.dxf", SQUARE);
    desk.correct("plate.obj", "square.dxf", "--station station.toml --part-unit mm --part-up z");
    let marked: Vec<_> = lines(&desk.read("out.dxf"), "0").concat();
    for (aim, drawn) in marked.iter().zip([[70.0, 50.0], [130.0, 50.0], [70.0, 110.0], [130.0, 110.0]]) {
        assert!((lens(*aim, 25.0) - Point2::from(drawn)).norm() < 0.01, "{aim} for {drawn:?}");
    }
}

#[test]
fn distances_between_crosses_of_another_grid_are_refused() {
    let desk = Desk::new();
    desk.write("station.toml", settings());
    assert_eq!(calibrate(&desk, "--draw lens --crosses 5").code, 0);
    let table = desk.text("lens/lens-positions.csv");
    let at = |name: &str| {
        let row = table.lines().find(|line| line.starts_with(&format!("{name};0;"))).unwrap();
        let cells: Vec<f64> = row.split(';').skip(2).take(2).map(|cell| cell.parse().unwrap()).collect();
        Point2::new(cells[0], cells[1])
    };
    // Typed with a decimal comma.
    let typed = |z: f64, [from, to]: [&str; 2]| {
        let length = (beam(at(from), z) - beam(at(to), z)).norm();
        format!("{z} {from} {to} {length:.2}").replace('.', ",")
    };
    let pairs = [["A1", "C1"], ["A1", "A3"], ["A3", "C3"], ["C1", "C3"]];
    let distances: Vec<String> =
        [0.0, 30.0].into_iter().flat_map(|z| pairs.map(|pair| typed(z, pair))).collect();
    let mut arguments = vec!["calibrate", "lens", "station.toml"];
    arguments.extend(distances.iter().flat_map(|typed| ["--distance", typed]));
    desk.isomark(&arguments).refused(1, &["field-scale", "0.5000 times", "--crosses 5"]);
    arguments.extend(["--crosses", "5"]);
    let output = desk.isomark(&arguments);
    assert!(output.code == 0 && output.out.contains("lens distance x   300."), "{output:?}");
}

#[test]
fn a_lens_that_the_settings_do_not_state_is_noted_where_it_matters() {
    let desk = Desk::new();
    let sides = |x: f64, y: f64| {
        let line = |[from, to]: [[f64; 2]; 2]| {
            format!("0\nLINE\n8\n0\n10\n{}\n20\n{}\n11\n{}\n21\n{}\n", from[0], from[1], to[0], to[1])
        };
        let sides = [[[-x, -y], [x, -y]], [[-x, y], [x, y]]].map(line).concat();
        SQUARE.split_once("0\nLINE").unwrap().0.to_owned() + &sides + "0\nENDSEC\n0\nEOF\n"
    };
    desk.write("wide.dxf", sides(20.0, 15.0));
    desk.write("small.dxf", sides(3.0, 2.0));
    let correct = |drawing: &str, options: &str| {
        desk.correct_to("out.dxf", &[drawing], &format!("--cylinder 66,120 {options}"))
    };
    let report = correct("wide.dxf", "");
    let notice =
        report["notices"].as_array().unwrap().iter().find(|notice| notice["code"] == "lens-assumed").unwrap();
    // The crest is 33 mm above the axis, and the ink reaches 20 mm round it; a lens over 110 mm is 1.6 times as far away.
    let (half, span) = (33.0 * (20.0f64 / 33.0).sin(), 33.0 * (1.0 - (20.0f64 / 33.0).cos()));
    let shift = format!("{:.1} mm against", half.hypot(15.0) * span / 176.0);
    assert!(
        notice["severity"] == "note" && notice["message"].as_str().unwrap().contains(&shift),
        "{shift}: {notice}"
    );
    let summary = desk.isomark(&["correct", "--cylinder", "66,120", "wide.dxf", "--out", "out.dxf"]).err;
    assert!(summary.contains("\n  note: the settings state no lens"), "{summary}");
    for (drawing, options) in [
        ("small.dxf", ""),
        ("wide.dxf", "--set optics.kind=telecentric"),
        (
            "wide.dxf",
            "--set optics.kind=perspective --set optics.lens_distance_x_mm=176 --set optics.lens_distance_y_mm=170",
        ),
    ] {
        assert!(!notices(&correct(drawing, options)).contains(&"lens-assumed"), "{drawing} {options}");
    }
    // What `init` writes states no lens.
    assert_eq!(desk.isomark(&["init", "line"]).code, 0);
    let checked = desk.isomark(&["check", "line/station.toml"]);
    assert!(checked.out.contains("the lens is not stated"), "{checked:?}");
    let stated = desk.isomark(&["check", "line/station.toml", "--set", "optics.kind=telecentric"]);
    assert!(!stated.out.contains("the lens is not stated"), "{stated:?}");
}
