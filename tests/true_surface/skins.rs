//! Parts with two skins: nobody can tell which of them is marked.

use isomark::geometry::facing_part::FacingPart;
use isomark::geometry::mesh::TriMesh;
use isomark::geometry::shapes;
use isomark::geometry::space::View;
use isomark::geometry::surface::fit::{FitError, FitOptions, FittedSurface};
use nalgebra::Vector3;

/// A dome, and a second mesh of it so many mm lower over a disc of a radius, wound alike or the other way round.
fn doubled(gap: f64, radius: f64, edge: f64, turned: bool) -> TriMesh {
    let (first, second) =
        (shapes::graph(25.0, 1.0, shapes::sphere), shapes::graph(radius, edge, shapes::sphere));
    let count = first.positions().len() as u32;
    let below = second.positions().iter().map(|at| at - Vector3::z() * gap);
    let moved = second.triangles().iter().map(|[a, b, c]| match turned {
        true => [a + count, c + count, b + count],
        false => [a + count, b + count, c + count],
    });
    let positions = first.positions().iter().copied().chain(below).collect();
    let triangles = first.triangles().iter().copied().chain(moved).collect();
    TriMesh::new(positions, Vec::new(), triangles).unwrap()
}

fn fit(mesh: &TriMesh) -> Result<FittedSurface, FitError> {
    FittedSurface::of_part(&FacingPart::new(mesh, &View::top()), &FitOptions::default())
}

#[test]
fn two_skins_are_refused_with_their_distance_and_place() {
    for (gap, edge) in [(0.01, 1.0), (0.01, 0.7), (0.04, 1.0), (-0.02, 1.3)] {
        let error = fit(&doubled(gap, 20.0, edge, false)).unwrap_err();
        let FitError::TwoSkins(skins) = error else { panic!("{error}") };
        // The chords of the facets are 0.004 mm below the sphere; along the laser's axis the distance is the gap.
        assert!((skins.gap - gap.abs()).abs() < 0.005, "{} mm for {gap} mm", skins.gap);
        assert!(skins.at.coords().norm() < 20.5 && skins.share > 0.4, "{skins:?}");
    }
}

#[test]
fn a_copy_and_the_far_side_of_a_sheet_are_no_second_skin() {
    for (gap, radius, turned) in
        [(0.0, 25.0, false), (0.01, 25.0, true), (1.0, 25.0, false), (0.01, 2.0, false)]
    {
        assert!(fit(&doubled(gap, radius, 1.0, turned)).is_ok(), "{gap} mm");
    }
}

#[test]
fn a_part_that_is_in_the_file_twice_is_the_part() {
    let once = fit(&shapes::graph(25.0, 3.0, shapes::sphere)).unwrap();
    for turned in [false, true] {
        let (mesh, other) = (shapes::graph(25.0, 3.0, shapes::sphere), doubled_at(3.0, turned));
        assert_eq!(other.triangles().len(), 2 * mesh.triangles().len());
        let twice = fit(&other).unwrap();
        assert!((twice.residual.max - once.residual.max).abs() < 1e-9, "{:?}", twice.residual);
        for (x, y) in [(0.4, 0.3), (5.0, -7.0), (-11.0, 2.5)] {
            let at = isomark::geometry::space::ViewPoint::new(x, y);
            assert!((twice.nurbs.height(at) - once.nurbs.height(at)).abs() < 1e-9);
            assert_eq!(twice.uncertainty(at), once.uncertainty(at));
            assert!(once.uncertainty(at).slope > 0.0);
        }
    }
}

/// A sphere with facets of a size, and its copy.
fn doubled_at(edge: f64, turned: bool) -> TriMesh {
    let mesh = shapes::graph(25.0, edge, shapes::sphere);
    let copies = mesh.triangles().iter().map(|&[a, b, c]| if turned { [a, c, b] } else { [a, b, c] });
    let triangles = mesh.triangles().iter().copied().chain(copies).collect();
    TriMesh::new(mesh.positions().to_vec(), Vec::new(), triangles).unwrap()
}
