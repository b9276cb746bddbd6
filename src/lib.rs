//! isomark bends flat drawings so that a galvo laser marks true lengths on curved parts. It reads a part and a drawing,
//! works out where every line comes to lie on the part, and writes the drawing that the marking software has to be given;
//! alone, or all day from a hot folder.
//!
//! # The flow
//!
//! ```text
//! part ──read──▶ TriMesh ──turn──▶ FacingPart ──sample──▶ HeightField ──fit──▶ FittedSurface ─┐  kept for each SKU
//! drawing ──read──▶ Pattern ──place──▶ Ink ───────────────────────────────────────────────────┴▶ LengthTrueMap
//!                                                                                                      │
//!           DXF + Report + picture ◀──write── MarkingDrawing ◀──bend── Projection ◀──fixture, lens─────┘
//! ```
//!
//! | stage | makes | from |
//! |---|---|---|
//! | [`formats::mesh::read`] | [`TriMesh`](geometry::mesh::TriMesh) | glTF, GLB or OBJ bytes |
//! | [`FacingPart::new`](geometry::height_field::FacingPart::new) | [`FacingPart`](geometry::height_field::FacingPart) | the mesh and the side that faces the laser |
//! | [`FittedSurface::of_part`](geometry::surface::fit::FittedSurface::of_part) | [`HeightField`](geometry::height_field::HeightField), [`NurbsSurface`](geometry::surface::nurbs::NurbsSurface), [`Residual`](geometry::surface::fit::Residual) | the facing part |
//! | [`formats::pattern::read`] | [`Pattern`](geometry::pattern::Pattern) | DXF or picture bytes |
//! | [`Ink::sample`](geometry::ink::Ink::sample) | [`Ink`](geometry::ink::Ink) | the placed pattern |
//! | [`LengthTrueMap::find`](geometry::mapping::LengthTrueMap::find) | [`LengthTrueMap`](geometry::mapping::LengthTrueMap) | surface and placed pattern |
//! | [`Projection::bend`](geometry::correction::Projection::bend) | [`MarkingDrawing`](geometry::marking::MarkingDrawing) | map, surface, fixture and lens |
//! | [`quality::measure`](geometry::mapping::quality::measure) | [`Distortion`](geometry::mapping::quality::Distortion) | map and sampled part |
//! | [`formats::pattern::write`] | DXF bytes | the marking drawing |
//! | [`formats::surface::write`] | STEP or OBJ bytes | the fitted surface |
//!
//! [`Pipeline`](pipeline::Pipeline) walks the whole way, with the [`Cache`](cache::Cache) and the
//! [`Report`](report::Report); [`hotfolder::run`] does it for every drop.
//!
//! # The front door
//!
//! [`Part`], [`Drawing`], [`Settings`] and [`Corrector`] are all that most programs need; everything behind them can be
//! reached in its module.
//!
//! ```
//! use isomark::{Corrector, Drawing, Part, Settings};
//!
//! # fn main() -> Result<(), isomark::Error> {
//! let part = Part::open("examples/parts/mouse.glb")?;
//! let drawing = Drawing::open("examples/patterns/letters.dxf")?;
//! let settings = Settings::default().facing("+z")?.place(0.0, 8.0);
//! let surface = Corrector::new().fit(&part, &settings)?;
//! let result = surface.correct(&drawing, &settings)?;
//! assert!(result.dxf().starts_with(b"999"));
//! assert!(result.report().quality.after.length_error_mm < 0.1);
//! # Ok(())
//! # }
//! ```
//!
//! The features `cli` (the program `isomark`) and `station` (the hot folder) are on by default. Without them the library
//! needs no command line, no thread and no watching of folders: `isomark = { version = "0.1", default-features = false }`.
//!
//! # An example from inside
//!
//! On a can of radius 30 mm, 15 mm of a line lie round an angle of 0.5 rad, so the laser must go to x = 30·sin 0.5 mm.
//!
//! ```
//! use isomark::geometry::height_field::FacingPart;
//! use isomark::geometry::ink::Ink;
//! use isomark::geometry::mapping::isometric::IsometricOptions;
//! use isomark::geometry::mapping::{LengthTrueMap, Method, quality};
//! use isomark::geometry::pattern::{Color, Layer, Path, Pattern, Segment, Shape, Source};
//! use isomark::geometry::shapes;
//! use isomark::geometry::space::{FlatPoint, View};
//! use isomark::geometry::surface::fit::{FitOptions, FittedSurface};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! // The part: a mesh, turned to the laser, sampled and fitted.
//! let can = shapes::graph(25.0, 0.75, shapes::cylinder);
//! let surface = FittedSurface::of_part(&FacingPart::new(&can, &View::top()), &FitOptions::default())?;
//!
//! // The drawing: one line of 30 mm across the can.
//! let line = Segment::Line { from: FlatPoint::new(-15.0, 0.0), to: FlatPoint::new(15.0, 0.0) };
//! let path = Path {
//!     layer: 0,
//!     color: Color::ByLayer,
//!     shape: Shape::Open(vec![line]),
//!     region: None,
//!     source: Source::default(),
//! };
//! let layers = vec![Layer { name: "MARK".into(), color: Color::Aci(7) }];
//! let drawing = Pattern { layers, paths: vec![path] };
//!
//! // The map, which recognises the cylinder by itself, keeps the drawing's middle where it is.
//! let method = Method::Auto {
//!     exact_tolerance: Method::EXACT_TOLERANCE,
//!     otherwise: IsometricOptions::INK,
//! };
//! let map = LengthTrueMap::find(&surface, &drawing, |_| true, FlatPoint::new(0.0, 0.0), &method)?;
//! let end = map.point(FlatPoint::new(15.0, 0.0));
//! assert!((end.x - 30.0 * 0.5f64.sin()).abs() < 1e-3 && end.y.abs() < 1e-3);
//!
//! // On the part the line is as long as it was drawn.
//! let ink = Ink::sample(&drawing, |_| true, quality::PIECE, quality::SQUARE);
//! let distortion = quality::measure(&ink, |at| map.point(at), |at| surface.sampled_height(at))
//!     .map_err(|at| format!("no surface at {at:?}"))?;
//! assert!((distortion.length - 30.0).abs() < 1e-9 && distortion.length_error < 2e-3);
//! # Ok(())
//! # }
//! ```
//!
//! # Words
//!
//! | word | means |
//! |---|---|
//! | part, mesh | the thing to be marked, and the triangles that describe it |
//! | primitive | a cylinder or cone given by its sizes, in place of a mesh |
//! | SKU | a product's identity; it owns a fitted surface |
//! | pattern, drawing | what is to be marked, flat, in true size |
//! | ink | the lines and inked areas of a drawing that count |
//! | part frame | the part's own axes, +Z up |
//! | view | the part as the laser sees it: x to the right, y up, z to the laser |
//! | field | the marking software's working area |
//! | height field | heights of the part over a grid of the view; holes and walls stay visible |
//! | surface, knots, span, control net | the NURBS surface that is fitted to the height field, and what it is made of |
//! | doubt | how far the part may be from the surface, because the file's normals contradict its facets |
//! | residual | what a fit leaves; never called an error |
//! | length-true map | from the drawing to the view, so that lengths on the part are those drawn |
//! | developable | can be unrolled without stretch: Gaussian curvature zero; only there all lengths can be kept |
//! | stretch | length on the part divided by length drawn, less 1 |
//! | e_l, e_a | length error and area error of a whole drawing, mm and mm² |
//! | chord tolerance | largest distance between a curve and the polyline that stands for it |
//! | bulge, block, layer, OCS | as in DXF |
//! | fixture, lens | where the part stands under the laser, and how the beam comes to it |
//! | station | one laser with its folders, field and optics |
//! | hot folder, drop | where files are put, and a file put there |
//! | job | one pattern on one SKU at one station |
//! | reason, notice | why an input was rejected; what was noticed and stopped nothing |
//!
//! Inside there are millimetres and radians. Settings and reports have degrees; every key names its unit.
//!
//! # Modules in reading order
//!
//! | module | is | knows |
//! |---|---|---|
//! | [`geometry`] | mathematics only: no file, clock, thread, log or format | nobody |
//! | [`printable`] | names and messages with all that does not print spelled out | nobody |
//! | [`reason`] | why something was rejected, what was noticed | `printable` |
//! | [`formats`] | bytes to values and back; the only place that names a format crate; opens no file | `geometry`, `printable`, `reason` |
//! | [`config`] | settings files to one validated station and one set of settings for each job | `geometry`, `reason`, `formats` |
//! | [`files`] | files written whole or not at all | nobody |
//! | [`cache`] | fitted surfaces on disk, for each SKU | `geometry`, `formats`, `config`, `files` |
//! | [`preview`] | the picture of a job | `geometry`, `printable` |
//! | [`diff`] | what changed between two drawings, in words | `geometry`, `printable` |
//! | [`report`] | the report of one job, in numbers | `geometry`, `printable`, `reason`, `formats`, `cache`, `diff` |
//! | [`pipeline`] | the corridor: read, sample, fit, map, bend, check, write | all above but `files` |
//! | [`Part`], [`Drawing`], [`Settings`], [`Corrector`] | the front door, in `front` | `pipeline`, `config`, `files`, `formats`, `cache`, `preview`, `reason`, `report`, `geometry` |
//! | [`hotfolder`] | folders, time and people | `pipeline`, `config`, `files`, `formats`, `cache`, `diff`, `printable`, `reason` |
//! | [`cli`] | what can be typed | all above but `preview` |
//!
//! No arrow leads back. `tests/layering.rs` reads the sources and keeps it so, crates included.
//!
//! # Where to add
//!
//! - **A mesh format**: one file in `src/formats/mesh/` and one variant in
//!   [`MeshFormat`](formats::mesh::MeshFormat); the compiler names the places that are still missing. Samples go to
//!   `tests/data/parts/`, their true sizes into its `truth.json`.
//! - **A method**: one file in `src/geometry/mapping/` with its source cited, one variant each in
//!   [`mapping::Method`](geometry::mapping::Method) and [`LengthTrueMap`](geometry::mapping::LengthTrueMap), and its name
//!   in [`config::Method`]. Its judge is a closed form on one of [`geometry::shapes`].
//! - **A check**: one function in `src/pipeline/checks.rs` that returns a [`Reason`](reason::Reason) or adds a
//!   [`Notice`](reason::Notice), and its limit, if people may change it, in [`config`] and `watch-config/`.

pub mod geometry;
pub mod printable;
pub mod reason;
pub mod formats;
pub mod config;
pub mod files;
pub mod cache;
pub mod preview;
pub mod diff;
pub mod report;
pub mod pipeline;
mod front;
#[cfg(feature = "station")]
pub mod hotfolder;
#[cfg(feature = "cli")]
pub mod cli;

pub use front::{Correction, Corrector, Drawing, Error, Part, Settings, Surface};
