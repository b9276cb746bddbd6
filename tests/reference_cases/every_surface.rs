//! Every kind of surface with every kind of drawing.

use isomark::geometry::pattern::Pattern;
use isomark::geometry::shapes;

use super::drawings::{disc, grid, letters, square};
use super::springs::Net;
use super::{Case, INK, MANDARIN, MOUSE, SPHERE, UNIFORM, case};

const SADDLE: Case = case("saddle", shapes::saddle, [0.0, 0.0]);
const BUMPS: Case = case("bumps", shapes::bumps, [0.0, 0.0]);
const TORUS: Case = case("torus", shapes::torus, [0.0, 0.0]);
const ELLIPSOID: Case = case("ellipsoid", shapes::ellipsoid, [0.0, 0.0]);

/// A drawing with the size of its box, mm.
struct Drawing {
    name: &'static str,
    pattern: Pattern,
}

fn drawings() -> [([f64; 2], [Drawing; 2]); 2] {
    let drawing = |name, pattern| Drawing { name, pattern };
    [
        ([39.0, 13.0], [drawing("letters", letters()), drawing("grid", grid(39.0, 13.0))]),
        ([30.0, 30.0], [drawing("square", square()), drawing("disc", disc())]),
    ]
}

fn holds(case: Case) {
    let surface = case.surface(28.5);
    for ([width, height], drawings) in drawings() {
        let net = Net::relaxed(case.height, case.place, width, height);
        for Drawing { name, pattern } in drawings {
            let even = case.judged(&surface, &pattern, &UNIFORM);
            let inked = case.judged(&surface, &pattern, &INK);
            even.print(case.name, name, "uniform");
            inked.print(case.name, name, "ink");
            let slow = case.measured(&case.placed(&pattern), |at| net.point(at));
            let within = |found: f64, slow: f64| (found - slow).abs() <= 0.05 * slow;
            assert!(within(even.length_error(), slow.length_error), "{name}: {even:?}, slowly {slow:?}");
            assert!(within(even.area_error(), slow.area_error), "{name}: {even:?}, slowly {slow:?}");
            assert!(even.angle() <= 1.05 * slow.max_angle_error.to_degrees(), "{name}: {even:?}, {slow:?}");

            assert!(inked.length_error() < even.length_error(), "{name}: {inked:?}, evenly {even:?}");
            assert!(
                pattern.paths.iter().all(|path| !path.shape.is_closed())
                    || inked.area_error() < even.area_error()
            );
            assert!(inked.angle() <= even.angle() + 0.1, "{name}: {inked:?}, evenly {even:?}");
            for found in [even.isometric(), inked.isometric()] {
                assert!(found.settled && found.iterations.len() <= 6, "{name}: {:?}", found.iterations);
            }
        }
    }
}

#[test]
fn sphere() {
    holds(SPHERE);
}

#[test]
fn mandarin() {
    holds(MANDARIN);
}

#[test]
fn mouse() {
    holds(MOUSE);
}

#[test]
fn saddle() {
    holds(SADDLE);
}

#[test]
fn bumps() {
    holds(BUMPS);
}

#[test]
fn torus() {
    holds(TORUS);
}

#[test]
fn ellipsoid() {
    holds(ELLIPSOID);
}
