//! Fits a surface to a part, evaluates heights, slopes and lengths, and writes the surface for CAD:
//! `cargo run --release --example fit` writes `target/mouse-fit.step`.

#![allow(clippy::print_stdout, reason = "an example prints its results")]

use std::collections::BTreeMap;
use std::fs;

use isomark::formats::mesh::{self, MeshFormat, MeshOptions};
use isomark::formats::surface::{self, SurfaceFormat};
use isomark::geometry::facing_part::FacingPart;
use isomark::geometry::space::{View, ViewPoint};
use isomark::geometry::surface::fit::{FitOptions, FittedSurface};
use nalgebra::Point3;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let bytes = fs::read("examples/parts/mouse.glb")?;
    let part = mesh::read(&bytes, MeshFormat::Glb, &MeshOptions::default(), &BTreeMap::new())?;
    let view = View::top();
    let mesh = part.shape.mesh().ok_or("not a mesh but a scan")?;
    let fitted = FittedSurface::of_part(&FacingPart::new(mesh, &view), &FitOptions::default())?;
    println!("largest residual of the fit: {:.4} mm, at {:?}", fitted.residual.max, fitted.residual.at);

    let at = ViewPoint::new(10.0, 40.0);
    let jet = fitted.jet(at);
    println!("at {at:?} mm: height {:.3} mm, tilt {:.1} deg", jet.height, jet.tilt().to_degrees());
    println!("1 mm along x in the view is {:.4} mm on the surface", jet.first_fundamental_form().m11.sqrt());
    let closest = fitted.nurbs.closest(Point3::new(at.x, at.y, 100.0)).ok_or("not finite")?;
    println!(
        "nearest point to a point at a height of 100 mm: {:?}, {:.2} mm away",
        closest.at, closest.distance
    );

    fs::write("target/mouse-fit.step", surface::write(&fitted, &view, "mouse.glb", SurfaceFormat::Step))?;
    Ok(())
}
