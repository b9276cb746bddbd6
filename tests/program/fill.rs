//! Fill lines, steps of focus and drawings in space, by command and by hot folder.

use std::collections::BTreeMap;

use isomark::formats::mesh::{self, MeshFormat, MeshOptions};
use isomark::formats::pattern::{PatternOptions, read};
use isomark::geometry::mesh::TriMesh;
use isomark::geometry::shapes;
use isomark::geometry::space::FlatPoint;
use serde_json::Value;

use crate::desk::{Desk, drawing, notices, number, numbers, part};
use crate::ezdxf::{assert_clean, judged};
use crate::station::{Station, files};

/// A flat plate of 200 x 200 mm.
const PLATE: &str = "v -100 -100 5\nv 100 -100 5\nv 100 100 5\nv -100 100 5\nf 1 2 3 4\n";
const AS_DRAWN: &str = "--part-unit mm --part-up z";

fn example(name: &str) -> String {
    format!("{}/examples/{name}", env!("CARGO_MANIFEST_DIR"))
}

/// A drawing of polylines: layer, whether it is closed, corners.
fn polylines(lines: &[(&str, bool, &[[f64; 2]])]) -> String {
    let polyline = |(layer, closed, corners): &(&str, bool, &[[f64; 2]])| {
        let corners: String = corners.iter().map(|[x, y]| format!("10\n{x}\n20\n{y}\n")).collect();
        format!("0\nLWPOLYLINE\n8\n{layer}\n90\n4\n70\n{}\n{corners}", u8::from(*closed))
    };
    let entities: String = lines.iter().map(polyline).collect();
    format!(
        "0\nSECTION\n2\nHEADER\n9\n$ACADVER\n1\nAC1015\n9\n$INSUNITS\n70\n4\n0\nENDSEC\n0\nSECTION\n2\nENTITIES\n{entities}\
         0\nENDSEC\n0\nEOF\n"
    )
}

const SQUARE: &[[f64; 2]] = &[[-10.0, -10.0], [10.0, -10.0], [10.0, 10.0], [-10.0, 10.0]];

/// The polylines of a corrected drawing, with their layers.
fn lines(dxf: &[u8]) -> Vec<(String, Vec<FlatPoint>)> {
    let mut options = PatternOptions::default();
    options.strict = true;
    let pattern = read(dxf, &options).unwrap().pattern;
    let path = |path: &isomark::geometry::pattern::Path| {
        (pattern.layers[path.layer].name.clone(), path.shape.flattened(1e-6))
    };
    pattern.paths.iter().map(path).collect()
}

/// The triangles of a part over the view from above.
struct Triangles {
    mesh: TriMesh,
    cells: BTreeMap<[i64; 2], Vec<usize>>,
}

impl Triangles {
    fn new(mesh: TriMesh) -> Self {
        let mut cells: BTreeMap<[i64; 2], Vec<usize>> = BTreeMap::new();
        for (index, corners) in mesh.triangles().iter().enumerate() {
            let at = corners.map(|corner| mesh.positions()[corner as usize]);
            let range = |axis: usize| {
                let values = at.map(|point| point[axis].floor() as i64);
                values.into_iter().min().unwrap()..=values.into_iter().max().unwrap()
            };
            for column in range(0) {
                for row in range(1) {
                    cells.entry([column, row]).or_default().push(index);
                }
            }
        }
        Self { mesh, cells }
    }

    /// The highest point of the part at a place.
    fn lift(&self, at: FlatPoint) -> nalgebra::Point3<f64> {
        let mut highest = f64::NEG_INFINITY;
        for index in self.cells.get(&[at.x.floor() as i64, at.y.floor() as i64]).into_iter().flatten() {
            let [a, b, c] =
                self.mesh.triangles()[*index].map(|corner| self.mesh.positions()[corner as usize]);
            let (u, v, p) = ((b - a).xy(), (c - a).xy(), at.coords() - a.coords.xy());
            let area = u.perp(&v);
            let (s, t) = (p.perp(&v) / area, u.perp(&p) / area);
            if area != 0.0 && s >= -1e-9 && t >= -1e-9 && s + t <= 1.0 + 1e-9 {
                highest = highest.max(a.z + s * (b.z - a.z) + t * (c.z - a.z));
            }
        }
        assert!(highest.is_finite(), "no triangle at {at:?}");
        nalgebra::Point3::new(at.x, at.y, highest)
    }
}

/// The share of places (in %) at which the distance to the next fill line, measured on the part, is not within 1 % of `spacing`.
fn uneven(dxf: &[u8], spacing: f64, part: &Triangles) -> f64 {
    let dense = |line: &[FlatPoint]| {
        let mut points = Vec::new();
        for ends in line.windows(2) {
            let steps = (ends[0].distance(ends[1]) / 0.05).ceil().max(1.0) as usize;
            points
                .extend((0..=steps).map(|step| part.lift(ends[0].lerp(ends[1], step as f64 / steps as f64))));
        }
        points
    };
    let all = lines(dxf);
    let fill: Vec<_> =
        all.iter().filter(|(layer, _)| layer.ends_with("-fill")).map(|(_, line)| dense(line)).collect();
    let (mut over, mut places) = (0usize, 0usize);
    for (index, line) in fill.iter().enumerate() {
        for point in line.iter().step_by(11) {
            let mut nearest: Option<(f64, bool)> = None;
            for other in fill.iter().skip(index + 1).take(8) {
                for (at, ends) in other.windows(2).enumerate() {
                    let (along, offset) = (ends[1] - ends[0], point - ends[0]);
                    let t = offset.dot(&along) / along.norm_squared();
                    if !t.is_finite() {
                        continue;
                    }
                    let is_end = (at == 0 && t <= 0.0) || (at + 2 == other.len() && t >= 1.0);
                    let distance = (offset - along * t.clamp(0.0, 1.0)).norm();
                    if nearest.is_none_or(|(least, _)| distance < least) {
                        nearest = Some((distance, is_end));
                    }
                }
            }
            if let Some((distance, false)) = nearest.filter(|(distance, _)| *distance < 1.8 * spacing) {
                places += 1;
                over += usize::from((distance / spacing - 1.0).abs() > 0.01);
            }
        }
    }
    assert!(places > 500, "only {places} places");
    100.0 * over as f64 / places as f64
}

#[test]
fn fill_lines_are_evenly_spaced_on_the_triangles_of_the_part() {
    let desk = Desk::new();
    let frame: &[[f64; 2]] = &[[-14.0, -9.0], [14.0, -9.0], [14.0, 9.0], [-14.0, 9.0]];
    let hole: &[[f64; 2]] = &[[-6.0, -2.0], [0.0, -4.0], [2.0, 3.0]];
    desk.write("frame.dxf", polylines(&[("MARK", true, frame), ("MARK", true, hole)]));
    let pattern = desk.path("frame.dxf").display().to_string();
    for (name, height) in [("mouse", shapes::mouse as fn(f64, f64) -> f64), ("mandarin", shapes::mandarin)] {
        let mesh = shapes::graph(25.0, 0.25, height);
        let mut obj = String::new();
        for at in mesh.positions() {
            obj += &format!("v {} {} {}\n", at.x, at.y, at.z);
        }
        for [a, b, c] in mesh.triangles() {
            obj += &format!("f {} {} {}\n", a + 1, b + 1, c + 1);
        }
        desk.write(&format!("{name}.obj"), &obj);
        let siblings = BTreeMap::new();
        let options = MeshOptions::default();
        // The same triangles, read from the file.
        let reading = mesh::read(obj.as_bytes(), MeshFormat::Obj, &options, &siblings);
        assert!(reading.is_ok());
        let triangles = Triangles::new(mesh);
        for angle in ["0", "90", "37"] {
            // Lines farther apart than the triangles are wide: those are flat, the surface between their corners is not.
            let options = format!("{AS_DRAWN} --place 0,0 --fill 0.75,{angle}");
            let report = desk.correct(&format!("{name}.obj"), &pattern, &options);
            let percent = uneven(&desk.read("out.dxf"), 0.75, &triangles);
            assert!(percent <= 1.0, "{name} {angle}: {percent} % are uneven; {:#}", report["fill"]);
            assert!(number(&report, "/fill/uneven_share") <= 0.01);
        }
    }
}

#[test]
fn fill_lines_have_their_own_layer_after_the_drawing_in_every_profile() {
    let desk = Desk::new();
    let without =
        desk.correct_to("plain.dxf", &[&example("parts/mouse.glb"), &drawing("abc")], "--place 0,8");
    let layers: Vec<String> = lines(&desk.read("plain.dxf")).into_iter().map(|(layer, _)| layer).collect();
    let mut counts = Vec::new();
    for profile in ["R2000", "R12", "R12-lines"] {
        let options =
            format!("--place 0,8 --fill 0.4,30 --set output.dxf={profile} --set delivery.verify=true");
        let report = desk.correct(&example("parts/mouse.glb"), &drawing("abc"), &options);
        assert_eq!(report["output"]["read_back"], Value::Bool(true));
        assert_eq!(report["quality"]["after"]["length_mm"], without["quality"]["after"]["length_mm"]);
        let dxf = desk.read("out.dxf");
        let found = lines(&dxf);
        let fill: Vec<&str> = numbers_of_layers(&report);
        assert!(fill.iter().all(|name| name.ends_with("-fill")), "{fill:?}");
        let is_fill = |(layer, _): &(String, Vec<FlatPoint>)| fill.contains(&layer.as_str());
        if profile != "R12-lines" {
            // Everything else comes first, in its order.
            let first = found.iter().position(is_fill).unwrap();
            assert!(found[..first].iter().map(|(layer, _)| layer).eq(&layers));
            assert!(found[first..].iter().all(is_fill));
            counts.push(found.len() - first);
            assert_eq!(found.len() - first, report["fill"]["lines"].as_u64().unwrap() as usize);
        }
        if let Some(found) = judged(&dxf) {
            assert_clean(&found);
            assert!(found["layers"].as_object().unwrap().keys().any(|layer| layer.ends_with("-fill")));
        }
    }
    assert_eq!(counts[0], counts[1]);
    // The same input gives the same bytes, and a changed spacing is found by `diff`.
    let again = "--place 0,8 --fill 0.4,30 --set output.dxf=R12-lines --set delivery.verify=true";
    desk.correct_to("again.dxf", &[&example("parts/mouse.glb"), &drawing("abc")], again);
    assert_eq!(desk.read("again.dxf"), desk.read("out.dxf"));
    assert_eq!(desk.isomark(&["diff", "again.dxf", "out.dxf"]).code, 0);
    assert!(desk.isomark(&["diff", "plain.dxf", "out.dxf"]).out.contains("-fill"));
}

fn numbers_of_layers(report: &Value) -> Vec<&str> {
    report["fill"]["layers"].as_array().unwrap().iter().map(|layer| layer.as_str().unwrap()).collect()
}

#[test]
fn texts_solid_hatches_and_chosen_layers_are_filled() {
    let desk = Desk::new();
    // A text and solid hatches with islands.
    for name in ["ez-hatch-islands", "fc020-text-legacy"] {
        let report = desk.correct(&example("parts/mouse.glb"), &drawing(name), "--place 0,0 --fill 0.05");
        let (area, inked) = (number(&report, "/fill/area_mm2"), number(&report, "/quality/after/area_mm2"));
        let length = number(&report, "/fill/length_mm");
        // The ink is measured in squares of 0.2 mm, which are coarse for thin letters.
        assert!((area - inked).abs() < 0.06 * inked, "{name}: {area} of {inked} mm2");
        assert!((length * 0.05 - area).abs() < 0.02 * area, "{name}: {length} mm for {area} mm2");
    }
    // The logo, without its frame.
    let options = "--facing -y --place 0,60 --fill 0.2 --set fill.layers=[\"logo\"]";
    let report = desk.correct(&example("parts/can.glb"), &example("patterns/logo.dxf"), options);
    assert_eq!(numbers_of_layers(&report), ["Logo-fill"]);
    assert!(number(&report, "/fill/area_mm2") < 0.5 * number(&report, "/quality/after/area_mm2"));
    // Round the can, spots are farther apart where the beam is inclined.
    let spots = numbers(&report, "/fill/spot_spacing");
    assert!((spots[0] - 1.0).abs() < 1e-3 && spots[1] > 1.1, "{spots:?}");
}

#[test]
fn what_cannot_be_filled_is_refused_or_noticed_with_its_number() {
    let desk = Desk::new();
    desk.write("plate.obj", PLATE);
    let correct = |dxf: String, options: &str| {
        desk.write("a.dxf", dxf);
        let words = format!("correct plate.obj a.dxf --json --out out.dxf {AS_DRAWN} {options}");
        desk.isomark(&words.split_whitespace().collect::<Vec<_>>())
    };
    let square = || polylines(&[("MARK", true, SQUARE)]);
    correct(square(), "--fill 0.001").refused(2, &["fill.spacing_mm", "0.005", "--fill 0.001"]);
    correct(square(), "--fill 0.1,45,225").refused(2, &["same direction", "what to do: "]);
    correct(square(), "--fill 0.1,1,2,3").refused(2, &["--fill 0.1,1,2,3"]);
    correct(square(), "--fill x").refused(2, &["--fill x"]);
    let large: &[[f64; 2]] = &[[-90.0, -90.0], [90.0, -90.0], [90.0, 90.0], [-90.0, 90.0]];
    correct(polylines(&[("MARK", true, large)]), "--fill 0.005")
        .refused(1, &["the fill", "length of the fill", "limit 5000000 mm", "`spacing_mm` under [fill]"]);
    let noticed = |dxf: String, options: &str| -> Value {
        let output = correct(dxf, options);
        assert_eq!(output.code, 0, "{}", output.err);
        serde_json::from_str(&output.out).unwrap()
    };
    // Open by 0.3 mm, beside a closed one.
    let open: &[[f64; 2]] = &[[20.0, 0.0], [30.0, 0.0], [30.0, 10.0], [20.0, 0.3]];
    let report = noticed(polylines(&[("MARK", true, SQUARE), ("MARK", false, open)]), "--fill 0.5");
    assert!(notices(&report).contains(&"fill-open"), "{report:#}");
    assert!(report["notices"].to_string().contains("0.300 mm"), "{report:#}");
    let report = noticed(polylines(&[("MARK", false, open)]), "--fill 0.5");
    assert!(notices(&report).contains(&"fill-nothing") && report.get("fill").is_none());
    let bow: &[[f64; 2]] = &[[-10.0, -10.0], [10.0, 10.0], [10.0, -10.0], [-10.0, 10.0]];
    let report = noticed(polylines(&[("MARK", true, bow)]), "--fill 0.5");
    assert!(notices(&report).contains(&"fill-crossing"), "{report:#}");
    let report = noticed(square(), "--fill 0.5 --set fill.layers=[\"MERK\"]");
    assert!(notices(&report).contains(&"fill-layer-missing"), "{report:#}");
    // 0 switches off what another file switches on.
    let report = noticed(square(), "--fill 0");
    assert!(report.get("fill").is_none());
}

#[test]
fn settings_of_a_product_and_beside_a_drawing_fill_in_a_running_station() {
    let station = Station::new();
    station.desk.write("skus/can.toml", "[part]\nfacing = \"-y\"\n[placement]\nplace_mm = [0, 60]\n[fixture]\ny_mm = -60\n[fill]\nspacing_mm = 0.5\n");
    station.copy_into(&part("can/fc020-gui.glb"), "can.glb");
    station.desk.write("hot/can@plain.toml", "[fill]\nspacing_mm = 0\n");
    station.desk.write("hot/can@dense.toml", "[fill]\nspacing_mm = 0.25\nangle_deg = 45\n");
    for name in ["usual", "plain", "dense"] {
        station.copy_into(&drawing("abc"), &format!("can@{name}.dxf"));
    }
    let output = station.once();
    assert_eq!(output.code, 0, "{}", output.err);
    let fills = |name: &str| {
        let found = lines(&station.desk.read(&format!("import/{name}")));
        found.iter().filter(|(layer, _)| layer.ends_with("-fill")).count()
    };
    let [usual, plain, dense] = ["usual", "plain", "dense"].map(|name| fills(&format!("can@{name}.dxf")));
    assert!(plain == 0 && usual > 10 && dense > usual, "{usual} {plain} {dense}");
}

#[test]
fn steps_of_focus_are_layers_of_a_delivered_drawing_and_files_of_a_command() {
    let desk = Desk::new();
    let (part, pattern) = (example("parts/can.glb"), drawing("abc"));
    let common = "--facing -y --place 0,60 --fill 0.5";
    let whole = desk.correct(&part, &pattern, common);
    let heights = numbers(&whole, "/exposure/height_mm");
    let range = heights[1] - heights[0];
    let step = format!("{:.3}", range / 2.5);
    let options =
        format!("{common} --set focus.steps=layers --set focus.step_mm={step} --step-files --xyz out.csv");
    let report = desk.correct_to("cut.dxf", &[&part, &pattern], &options);
    let steps = report["focus"]["steps"].as_array().unwrap();
    assert_eq!(steps.len(), 3);
    let found = lines(&desk.read("cut.dxf"));
    // Every point is within the heights of its layer: on the can, the height follows from the place.
    let radius = 33.0;
    for (step, focus) in steps.iter().map(|step| (step, step["focus_mm"].as_f64().unwrap())) {
        let name = format!("-z{focus:+08.3}");
        let range = numbers(step, "/height_mm");
        let mut count = 0;
        for (_, line) in found.iter().filter(|(layer, _)| layer.ends_with(&name)) {
            count += 1;
            for point in line {
                let height = (radius * radius - point.x * point.x).sqrt();
                assert!((range[0] - 0.02..=range[1] + 0.02).contains(&height), "{height} in {range:?}");
            }
        }
        assert!(count > 0 && count == step["paths"].as_u64().unwrap() as usize);
        let file = desk.read(&format!("cut.z{focus:+08.3}.dxf"));
        assert_eq!(lines(&file).len(), count);
        assert!(lines(&file).iter().all(|(layer, _)| !layer.contains("-z")));
        if let Some(found) = judged(&file) {
            assert_clean(&found);
        }
    }
    // The files of an earlier run with other steps are named; other files are not.
    let earlier: Vec<String> =
        steps.iter().map(|step| format!("cut.z{:+08.3}.dxf", step["focus_mm"].as_f64().unwrap())).collect();
    for other in ["cut.zebra.dxf", "cut.z+001.000.svg", "other.z+001.000.dxf"] {
        desk.write(other, "");
    }
    let one =
        format!("{common} --set focus.steps=layers --set focus.step_mm={:.3} --step-files", range * 2.0);
    let again = |options: &str| {
        let words = format!("correct {part} {pattern} --out cut.dxf {options}");
        desk.isomark(&words.split_whitespace().collect::<Vec<_>>()).err
    };
    let warning = again(&one);
    let warning = warning.lines().find(|line| line.contains("not part of this mark")).unwrap();
    assert!(earlier.iter().all(|file| warning.contains(file.as_str())), "{warning}");
    assert_eq!(warning.matches(".dxf").count(), earlier.len(), "{warning}");
    assert!(!again(&options).contains("not part of this mark"));
    // In space, every point is on the can.
    let text = desk.text("out.csv");
    let mut rows = text.lines();
    assert_eq!(rows.next(), Some("path,layer,closed,x_mm,y_mm,z_mm"));
    for row in rows.clone() {
        let values: Vec<f64> = row.rsplitn(4, ',').take(3).map(|value| value.parse().unwrap()).collect();
        assert!((values[2].hypot(values[0]) - radius).abs() < 0.02, "{row}");
    }
    assert!(rows.count() > found.len());
    // What is cut cannot be filled by the marking software any more.
    let opens = |report: &Value| report["notices"].to_string().contains("focus-opens-contours");
    let unfilled = options.replace("--fill 0.5", "").replace("--step-files --xyz out.csv", "");
    assert!(!opens(&report) && opens(&desk.correct(&part, &pattern, &unfilled)));
    // Without a height, the settings are refused.
    let words = format!("correct {part} {pattern} --out no.dxf {common} --set focus.steps=layers");
    desk.isomark(&words.split_whitespace().collect::<Vec<_>>()).refused(2, &["`step_mm`", "focus_depth_mm"]);

    let station = Station::new();
    station.copy_into(&part, "can.glb");
    station.copy_into(&pattern, "can@steps.dxf");
    let settings = station.desk.text("station.toml");
    station
        .desk
        .write("station.toml", settings + &format!("[focus]\nsteps = \"layers\"\nstep_mm = {step}\n"));
    assert_eq!(station.once().code, 0);
    assert_eq!(files(&station.path("import")), ["can@steps.dxf"]);
    let layers: std::collections::BTreeSet<String> =
        lines(&station.desk.read("import/can@steps.dxf")).into_iter().map(|(layer, _)| layer).collect();
    assert!(layers.len() >= 3 && layers.iter().all(|layer| layer.contains("-z")), "{layers:?}");
}

#[test]
fn a_drawing_in_space_is_a_clean_dxf_on_the_part() {
    let desk = Desk::new();
    let options = "--facing -y --place 0,60 --xyz space.dxf";
    desk.correct(&example("parts/can.glb"), &drawing("abc"), options);
    let text = desk.text("space.dxf");
    assert!(text.contains("AcDb3dPolyline") && text.contains("AcDb3dPolylineVertex"));
    if let Some(found) = judged(text.as_bytes()) {
        assert_clean(&found);
        let entities = found["entities"].as_array().unwrap();
        assert!(!entities.is_empty() && entities.iter().all(|entity| entity["type"] == "POLYLINE"));
        assert!(entities.iter().any(|entity| entity["closed"] == Value::Bool(true)));
    }
    desk.isomark(&[
        "correct",
        &example("parts/can.glb"),
        &drawing("abc"),
        "--out",
        "a.dxf",
        "--xyz",
        "space.txt",
    ])
    .refused(2, &["--xyz", ".dxf"]);
    desk.isomark(&[
        "correct",
        &example("parts/can.glb"),
        &drawing("abc"),
        "--out",
        "a.dxf",
        "--xyz",
        "a.dxf",
    ])
    .refused(2, &["--xyz"]);
}

#[test]
fn lines_closer_than_the_spot_are_refused() {
    let desk = Desk::new();
    desk.write("plate.obj", PLATE);
    desk.write("square.dxf", polylines(&[("A", true, SQUARE)]));
    let fill = |spot: &str| {
        let arguments = [
            "correct",
            "plate.obj",
            "square.dxf",
            "-o",
            "out.dxf",
            "--fill",
            "0.04",
            "--json",
            "--set",
            spot,
        ];
        desk.isomark(&arguments.into_iter().chain(AS_DRAWN.split_whitespace()).collect::<Vec<_>>())
    };
    fill("optics.spot_mm=0.05").refused(1, &["0.04 mm apart", "spot is 0.05 mm", "spacing_mm"]);
    assert_eq!(fill("optics.spot_mm=0.04").code, 0);
}

/// A square with sides of 8 mm round a place of the drawing.
fn square_at(x: f64) -> Vec<[f64; 2]> {
    [[-4.0, -4.0], [4.0, -4.0], [4.0, 4.0], [-4.0, 4.0]].map(|[dx, y]| [x + dx, y]).to_vec()
}

#[test]
fn contours_are_filled_in_every_tile_of_a_mark_round_the_part() {
    let desk = Desk::new();
    // Twelve squares round a cylinder with a circumference of 60 π mm.
    let places: Vec<Vec<[f64; 2]>> =
        (0..12).map(|i| square_at(f64::from(2 * i - 11) * std::f64::consts::PI * 2.5)).collect();
    let squares: Vec<(&str, bool, &[[f64; 2]])> =
        places.iter().map(|corners| ("LOGO", true, corners.as_slice())).collect();
    desk.write("round.dxf", polylines(&squares));
    let options = "--cylinder 60,50 --rotary --fill 0.5 --set fill.layers=logo";
    let report = desk.correct_to("out.dxf", &["round.dxf"], options);
    let length: f64 = lines(&desk.read("out.dxf"))
        .iter()
        .filter(|(layer, _)| layer.ends_with("LOGO-fill"))
        .flat_map(|(_, line)| {
            line.windows(2).map(|ends| unrolled(ends[0]).distance(unrolled(ends[1]))).collect::<Vec<_>>()
        })
        .sum();
    // 16 or 17 lines of 8 mm in each square.
    assert!((12.0 * 16.0 * 8.0 - 1.0..=12.0 * 17.0 * 8.0 + 1.0).contains(&length), "{length} mm");
    assert!(report["rotary"]["tiles"].as_array().unwrap().len() >= 4);
}

/// A point of the field on the unrolled cylinder with a radius of 30 mm.
fn unrolled(at: FlatPoint) -> FlatPoint {
    FlatPoint::new(30.0 * (at.x / 30.0).asin(), at.y)
}

#[test]
fn a_filled_contour_that_no_tile_holds_is_refused() {
    let desk = Desk::new();
    let wide = [[-60.0, -4.0], [60.0, -4.0], [60.0, 4.0], [-60.0, 4.0]];
    desk.write("wide.dxf", polylines(&[("LOGO", true, &wide)]));
    let correct = |options: &str| {
        let arguments = "correct --cylinder 60,50 wide.dxf -o out.dxf --json --rotary".split(' ');
        desk.isomark(&arguments.chain(options.split_whitespace()).collect::<Vec<_>>())
    };
    correct("--fill 0.5").refused(1, &["1 contour of the fill would be cut between tiles", "layers"]);
    assert_eq!(correct("").code, 0);
}

#[test]
fn files_of_tiles_contain_their_fill_and_their_steps_of_focus() {
    let desk = Desk::new();
    let places: Vec<Vec<[f64; 2]>> = [-40.0, -20.0, 0.0, 20.0, 40.0].map(square_at).to_vec();
    let squares: Vec<(&str, bool, &[[f64; 2]])> =
        places.iter().map(|corners| ("LOGO", true, corners.as_slice())).collect();
    desk.write("round.dxf", polylines(&squares));
    let length = |file: &str, layer: &str| -> f64 {
        let of_layer = lines(&desk.read(file)).into_iter().filter(|(name, _)| name.starts_with(layer));
        of_layer
            .flat_map(|(_, line)| line.windows(2).map(|ends| ends[0].distance(ends[1])).collect::<Vec<_>>())
            .sum()
    };
    let options = "--cylinder 60,50 --rotary --fill 0.5 --set focus.steps=layers --set focus.step_mm=1";
    let correct = |more: &str| {
        let words = format!("correct round.dxf -o out.dxf {options} {more}");
        let output = desk.isomark(&words.split_whitespace().collect::<Vec<_>>());
        assert_eq!(output.code, 0, "{}", output.err);
    };
    correct("");
    let together = length("out.dxf", "R");
    correct("--tiles-as files");
    let tiles =
        files(desk.root()).into_iter().filter(|name| name.starts_with("out.r") && name.ends_with(".dxf"));
    let tiles: Vec<String> = tiles.filter(|name| !name.contains("rotary")).collect();
    assert!(tiles.len() >= 2, "{tiles:?}");
    let apart: f64 = tiles.iter().map(|tile| length(tile, "LOGO")).sum();
    assert!((apart - together).abs() < 1e-3 && apart > 5.0 * 8.0 * 16.0, "{apart} of {together} mm");
}

#[test]
fn letters_of_single_strokes_are_not_filled() {
    let desk = Desk::new();
    desk.write("plate.obj", PLATE);
    let text = "0\nSECTION\n2\nENTITIES\n0\nTEXT\n8\nT\n10\n-20\n20\n0\n40\n8\n1\nA0480\n0\nENDSEC\n0\nEOF\n";
    desk.write("text.dxf", text);
    let report = desk.correct("plate.obj", "text.dxf", &format!("{AS_DRAWN} --fill 0.3"));
    let is_stroke = number(&report, "/quality/after/area_mm2") < 1.0;
    let filled = report.get("fill").is_some_and(|fill| !fill.is_null());
    assert!(filled != is_stroke || notices(&report).contains(&"fill-nothing"), "{report}");
}
