//! The maps that lower one figure alone: no aim leaves less of that figure, and closed forms show how little can be left.

use isomark::geometry::mapping::Method;
use isomark::geometry::mapping::isometric::IsometricOptions;
use isomark::geometry::shapes;

use super::developables::CONE;
use super::drawings::{disc, letters, square};
use super::{CYLINDER, Case, Judged, MANDARIN, MOUSE, SPHERE, UNIFORM, case};

const SADDLE: Case = case("saddle", shapes::saddle, [0.0, 0.0]);
const AIMS: [IsometricOptions; 4] =
    [IsometricOptions::INK, IsometricOptions::LENGTHS, IsometricOptions::AREAS, IsometricOptions::SHAPES];
const ONLY: [(&str, IsometricOptions); 3] = [
    ("lengths", IsometricOptions::ONLY_LENGTHS),
    ("areas", IsometricOptions::ONLY_AREAS),
    ("angles", IsometricOptions::ONLY_ANGLES),
];

fn figures(judged: &Judged) -> [f64; 3] {
    [judged.length_error(), judged.area_error(), judged.angle()]
}

#[test]
fn no_aim_leaves_less_than_the_map_for_that_figure_alone() {
    for case in [SPHERE, SADDLE, MANDARIN, MOUSE] {
        let surface = case.surface(28.5);
        for (name, drawing) in [("letters", letters()), ("square", square())] {
            let of = |options| case.judged(&surface, &drawing, &Method::Isometric(options));
            let aims = AIMS.map(|aim| figures(&of(aim)));
            for (figure, (only, options)) in ONLY.into_iter().enumerate() {
                let floor = of(options);
                floor.print(case.name, name, only);
                let least = aims.iter().map(|aim| aim[figure]).fold(f64::INFINITY, f64::min);
                // What the fitted surface leaves, below what is reported, is in both.
                assert!(
                    figures(&floor)[figure] <= least + 5e-4,
                    "{} {name}, {only}: {floor:?}, aims {aims:?}",
                    case.name
                );
            }
        }
    }
}

/// On a sphere, Lambert's azimuthal map keeps all areas, the stereographic one all angles, and the equidistant one, scaled,
/// the length of a circle: each figure of a disc can be 0 alone.
#[test]
fn each_figure_of_a_disc_on_a_sphere_can_be_kept_alone() {
    let surface = SPHERE.surface(28.5);
    let even = figures(&SPHERE.judged(&surface, &disc(), &UNIFORM));
    for (figure, (only, options)) in ONLY.into_iter().enumerate() {
        let floor = SPHERE.judged(&surface, &disc(), &Method::Isometric(options));
        floor.print("sphere", "disc", only);
        assert!(figures(&floor)[figure] < 0.05 * even[figure], "{only}: {floor:?}, even {even:?}");
    }
    // With true areas the circle of radius r = R/2 has the circumference 2πr·√(1 − r²/4R²): 3.0 mm are missing.
    let areas = SPHERE.judged(&surface, &disc(), &Method::Isometric(IsometricOptions::ONLY_AREAS));
    assert!(areas.length_error() > 2.5, "{areas:?}");
}

/// The floor is the least of all maps: where nothing but what the fitted surface leaves remains, an aim may reach less than the
/// map for one figure alone.
#[test]
fn nothing_is_left_on_cylinders_and_cones() {
    for case in [CYLINDER, CONE] {
        let surface = case.surface(28.5);
        let of = |options| case.judged(&surface, &letters(), &Method::Isometric(options));
        let balanced = figures(&of(IsometricOptions::INK));
        for (figure, (only, options)) in ONLY.into_iter().enumerate() {
            let floor = of(options);
            floor.print(case.name, "letters", only);
            let least = figures(&floor)[figure].min(balanced[figure]);
            assert!(least < [5e-3, 5e-3, 0.02][figure], "{only}: {floor:?}, balanced {balanced:?}");
        }
    }
}
