//! The preview of a job, for parts whose true lengths are known in closed form.

use std::f64::consts::{PI, TAU};

use isomark::geometry::space::Extents;
use isomark::preview::{HeightPicture, Preview, PreviewPath, svg};

/// A part given by formulas: its height, and the map of a flat drawing onto it.
struct Part {
    height: fn(f64, f64) -> Option<f64>,
    /// From the drawing to the view.
    lay: fn([f64; 2]) -> [f64; 2],
    half_size: [f64; 2],
}

/// A ball of radius 30 mm with the azimuthal equidistant map: true lengths from its top in every direction.
const BALL: Part = Part {
    height: |x, y| Some(900.0 - x * x - y * y).filter(|squared| *squared > 0.0).map(f64::sqrt),
    lay: |[s, t]| {
        let length = s.hypot(t).max(1e-12);
        let shrink = 30.0 * (length / 30.0).sin() / length;
        [s * shrink, t * shrink]
    },
    half_size: [32.0, 32.0],
};

/// A round-ended shell 60 mm wide and 110 mm long; under the pattern it is a cylinder of radius 30 mm.
const SHELL: Part = Part {
    height: |x, y| {
        let beyond = (y.abs() - 25.0).max(0.0);
        Some(900.0 - x * x - beyond * beyond).filter(|squared| *squared > 0.0).map(f64::sqrt)
    },
    lay: |[s, t]| [30.0 * (s / 30.0).sin(), t],
    half_size: [32.0, 57.0],
};

/// The outlines of A, B and C in a box of 39 × 13 mm about the origin, divided into pieces of about 0.2 mm.
fn letters() -> Vec<Vec<[f64; 2]>> {
    let arc = |center: [f64; 2], radii: [f64; 2], from: f64, to: f64| {
        let angle = move |step: usize| from + (to - from) * step as f64 / 48.0;
        (0..=48).map(move |step| {
            let (sin, cos) = angle(step).sin_cos();
            [center[0] + radii[0] * cos, center[1] + radii[1] * sin]
        })
    };
    let bow = |center: [f64; 2], radii: [f64; 2], left: f64| {
        let mut points = vec![[left, center[1] - radii[1]]];
        points.extend(arc(center, radii, -PI / 2.0, PI / 2.0));
        points.push([left, center[1] + radii[1]]);
        points
    };
    let mut b = vec![[-5.0, -6.5]];
    b.extend(arc([0.2, -2.9], [4.6, 3.6], -PI / 2.0, PI * 0.45));
    b.extend(arc([-0.2, 3.5], [4.2, 3.0], -PI * 0.40, PI / 2.0));
    b.push([-5.0, 6.5]);
    let mut c: Vec<_> = arc([14.0, 0.0], [7.5, 6.5], TAU * 0.12, TAU * 0.88).collect();
    c.extend(arc([14.0, 0.0], [5.2, 4.4], TAU * 0.87, TAU * 0.13));
    let contours = vec![
        vec![
            [-19.5, -6.5],
            [-17.0, -6.5],
            [-15.9, -3.4],
            [-10.6, -3.4],
            [-9.5, -6.5],
            [-7.0, -6.5],
            [-11.9, 6.5],
            [-14.6, 6.5],
        ],
        vec![[-15.2, -1.4], [-11.3, -1.4], [-13.25, 4.2]],
        b,
        bow([0.0, -2.9], [2.6, 1.8], -2.9),
        bow([-0.3, 3.3], [2.3, 1.4], -2.9),
        c,
    ];
    contours.into_iter().map(|contour| subdivided(&contour)).collect()
}

fn subdivided(contour: &[[f64; 2]]) -> Vec<[f64; 2]> {
    let sides = contour.iter().zip(contour.iter().cycle().skip(1));
    sides
        .flat_map(|(a, b)| {
            let pieces = ((b[0] - a[0]).hypot(b[1] - a[1]) / 0.2).ceil().max(1.0);
            (0..pieces as usize).map(move |piece| {
                let t = piece as f64 / pieces;
                [a[0] + (b[0] - a[0]) * t, a[1] + (b[1] - a[1]) * t]
            })
        })
        .collect()
}

impl Part {
    fn lifted(&self, [x, y]: [f64; 2]) -> [f64; 3] {
        [x, y, (self.height)(x, y).unwrap_or(f64::NAN)]
    }

    /// The contour `drawn` with its stretch on the part when the laser draws `placed`.
    fn path(&self, drawn: &[[f64; 2]], placed: Vec<[f64; 2]>) -> PreviewPath {
        let length = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| (b - a).powi(2)).sum::<f64>().sqrt();
        let stretch = (0..drawn.len()).map(|index| {
            let next = (index + 1) % drawn.len();
            let on_part = length(&self.lifted(placed[index]), &self.lifted(placed[next]));
            on_part / length(&drawn[index], &drawn[next]) - 1.0
        });
        PreviewPath { stretch: stretch.collect(), closed: true, points: placed }
    }

    fn picture(&self) -> HeightPicture {
        let origin = self.half_size.map(|half| -half);
        let step = 0.5;
        let [columns, rows] = self.half_size.map(|half| (2.0 * half / step) as usize + 1);
        let place = |start: f64, node: usize| start + step * node as f64;
        let heights = (0..columns * rows)
            .map(|index| (self.height)(place(origin[0], index % columns), place(origin[1], index / columns)));
        HeightPicture { origin, step, columns, rows, heights: heights.collect(), ..HeightPicture::default() }
    }

    fn preview(&self, title: &str) -> Preview {
        let letters = letters();
        let placed = |place: &dyn Fn([f64; 2]) -> [f64; 2]| -> Vec<PreviewPath> {
            let path = |letter: &Vec<[f64; 2]>| {
                self.path(letter, letter.iter().map(|point| place(*point)).collect())
            };
            letters.iter().map(path).collect()
        };
        let (before, after) = (placed(&|point| point), placed(&self.lay));
        let error = |paths: &[PreviewPath]| -> f64 {
            let contours = letters.iter().zip(paths);
            contours.map(|(letter, path)| length_error(letter, path)).sum()
        };
        let summary = vec![
            ("length error".into(), format!("{:.2} mm → {:.2} mm", error(&before), error(&after))),
            ("surface".into(), "closed form".into()),
        ];
        Preview {
            title: title.into(),
            part_outline: self.picture().into(),
            before,
            after,
            field: Some(Extents::of([[-55.0, -55.0].into(), [55.0, 55.0].into()])),
            summary,
            ..Preview::default()
        }
    }
}

/// Sum of the absolute length changes of the pieces of a contour on the part, mm.
fn length_error(drawn: &[[f64; 2]], path: &PreviewPath) -> f64 {
    let sides = drawn.iter().zip(drawn.iter().cycle().skip(1));
    sides.zip(&path.stretch).map(|((a, b), stretch)| (b[0] - a[0]).hypot(b[1] - a[1]) * stretch.abs()).sum()
}

#[test]
fn letters_on_a_ball_show_the_stretch_before_and_after() {
    let picture = written("ball", &BALL.preview("ball · abc.dxf · azimuthal"));
    assert!(picture.contains("0 % to +33.5 %"), "without a correction the ends are stretched");
    assert!(picture.contains("−4.6 % to 0 %"), "the azimuthal map shortens lengths across the radius");
    assert!(picture.contains("pattern 39 × 13 mm") && picture.contains("field 110 × 110 mm"));
    assert!(picture.contains("scale 1 : 1"));
    assert!(picture.len() < 250_000, "{} bytes", picture.len());
}

#[test]
fn letters_on_a_shell_have_true_lengths() {
    let picture = written("shell", &SHELL.preview("shell · abc.dxf · cylinder"));
    let after = picture.split(">After<").nth(1).unwrap();
    assert!(after.contains("length change on the part: 0 %"), "every length is true on a cylinder");
    assert!(picture.contains("+31.1 %"), "lengths are wrong without the correction");
}

#[test]
fn small_and_large_patterns_are_drawn_at_a_stated_scale() {
    for (factor, name) in [(0.1, "scale 20 : 1"), (10.0, "scale 1 : 5")] {
        let mut preview = BALL.preview("scaled");
        for path in preview.before.iter_mut().chain(&mut preview.after) {
            path.points.iter_mut().for_each(|point| *point = point.map(|coordinate| coordinate * factor));
        }
        assert!(written(name, &preview).contains(name), "{factor}");
    }
}

#[test]
fn a_preview_without_part_or_lines_is_still_valid() {
    let nothing = written("nothing", &Preview::default());
    assert!(nothing.contains("nothing drawn") && nothing.ends_with("</svg>\n"));
    let mut unmeasured = BALL.preview("<&\">'");
    unmeasured.part_outline = HeightPicture::default().into();
    unmeasured.before[0].stretch = vec![f64::NAN; 400];
    unmeasured.before[1].points[0] = [f64::INFINITY, 0.0];
    unmeasured.field = Some(Extents::EMPTY);
    let unmeasured = written("unmeasured", &unmeasured);
    assert!(unmeasured.contains("no surface measured"));
    assert!(unmeasured.contains("&lt;&amp;&quot;&gt;&#39;"));
    assert!(!unmeasured.contains("NaN") && !unmeasured.contains("inf"));
}

#[test]
fn the_same_preview_gives_the_same_bytes() {
    assert_eq!(svg(&SHELL.preview("same")), svg(&SHELL.preview("same")));
}

/// The picture, also written to the test's temporary folder so that a person can look at it.
fn written(name: &str, preview: &Preview) -> String {
    let picture = svg(preview);
    let file = std::path::Path::new(env!("CARGO_TARGET_TMPDIR"))
        .join(format!("{}.svg", name.replace([' ', ':', ','], "")));
    std::fs::write(file, &picture).expect("the folder for temporary files of tests can be written");
    picture
}

#[test]
fn places_with_a_large_residual_are_shown_and_explained() {
    let mut picture = BALL.picture();
    let middle = picture.rows / 2 * picture.columns + picture.columns / 2;
    picture.residual_limit = 0.02;
    picture.residuals = vec![0.001; picture.heights.len()];
    let drawn = |picture: &HeightPicture| {
        svg(&Preview { part_outline: picture.clone().into(), ..Preview::default() })
    };
    let legend = "residual of the surface &gt; 0.02 mm";
    assert!(!drawn(&picture).contains(legend));
    for residual in [0.021, -0.021] {
        picture.residuals[middle] = residual;
        assert!(drawn(&picture).contains(legend), "{residual}");
    }
}

#[test]
fn the_view_after_is_the_frame_of_the_second_panel() {
    for (name, part) in [("ball, after", BALL), ("shell, after", SHELL)] {
        let picture = written(name, &part.preview(name));
        let view =
            picture.split("<view id=\"after\" viewBox=\"").nth(1).and_then(|rest| rest.split('"').next());
        let numbers: Vec<&str> = view.expect("a view").split(' ').collect();
        let frame = format!(
            "<rect x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\" stroke=",
            numbers[0], numbers[1], numbers[2], numbers[3]
        );
        assert!(picture.contains(&frame), "{frame}");
        let heading = picture.split('<').find(|element| element.ends_with(">After")).expect("a heading");
        assert!(heading.contains(&format!(" x=\"{}\"", numbers[0])), "{heading}");
    }
}
