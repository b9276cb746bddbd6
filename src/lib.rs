//! isomark bends flat drawings so that a galvo laser marks true lengths on curved parts. It reads a part and a
//! drawing, computes where every line must be on the part, and writes the corrected drawing for the marking software:
//! for a single job, or continuously from a hot folder.
//!
//! # The flow
//!
//! ```text
//! part ──read──▶ TriMesh ──turn──▶ FacingPart ──sample──▶ HeightField ──fit──▶ FittedSurface ─┐  kept for each SKU
//! drawing ──read──▶ Pattern ──place──▶ Ink ───────────────────────────────────────────────────┴▶ LengthTrueMap
//!                                                                                                      │
//!          DXF + Report + pictures ◀──write── MarkingDrawing ◀──bend── Projection ◀──fixture, lens─────┘
//! ```
//!
//! | function | result | input |
//! |---|---|---|
//! | [`formats::mesh::read`] | [`TriMesh`](geometry::mesh::TriMesh) | bytes of a part file |
//! | [`FacingPart::new`](geometry::facing_part::FacingPart::new) | [`FacingPart`](geometry::facing_part::FacingPart) | the mesh and the side that faces the laser |
//! | [`FittedSurface::of_part`](geometry::surface::fit::FittedSurface::of_part) | [`HeightField`](geometry::height_field::HeightField), [`NurbsSurface`](geometry::surface::nurbs::NurbsSurface), [`Residual`](geometry::surface::fit::Residual) | the facing part |
//! | [`formats::pattern::read`] | [`Pattern`](geometry::pattern::Pattern) | DXF, SVG or picture bytes |
//! | [`quality::sample`](geometry::mapping::quality::sample) | [`Ink`](geometry::ink::Ink) | the placed pattern |
//! | [`LengthTrueMap::find`](geometry::mapping::LengthTrueMap::find) | [`LengthTrueMap`](geometry::mapping::LengthTrueMap) | surface and placed pattern |
//! | [`Projection::bend`](geometry::correction::Projection::bend) | [`MarkingDrawing`](geometry::marking::MarkingDrawing) | map, surface, fixture and lens |
//! | [`fill`](geometry::fill::fill) | [`Filling`](geometry::fill::Filling) | closed contours, map, surface, fixture and lens |
//! | [`quality::measure`](geometry::mapping::quality::measure) | [`Distortion`](geometry::mapping::quality::Distortion) | map and sampled part |
//! | [`formats::pattern::write`] | DXF bytes | the marking drawing |
//! | [`formats::surface::write`] | STEP or OBJ bytes | the fitted surface |
//!
//! [`Pipeline`](pipeline::Pipeline) runs all stages, with the [`Cache`](cache::Cache) and the
//! [`Report`](report::Report); [`hotfolder::run`] does this for every drop.
//!
//! # The front door
//!
//! Most programs need only [`Part`], [`Drawing`], [`Settings`] and [`Corrector`]; everything else is available in its
//! module.
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
//! The features `cli` (the program `isomark`), `station` (the hot folder), `page` (its page in browsers) and `fleet` (what
//! stations share) are on by default. Without them (`isomark = { version = "0.1", default-features = false }`) the library has no command line, no
//! folder watching, and no threads but those that fit a part and find its map ([`cores`]).
//!
//! Errors, reports and settings may get more variants and fields in a minor version. Match errors with a `_` arm, and make
//! settings from their `Default`: `let mut settings = JobSettings::default(); settings.placement.rotate = 0.1;`. All types
//! of the front door are `Send` and `Sync`.
//!
//! # An example with the inner modules
//!
//! On a can of radius 30 mm, 15 mm of a line cover an angle of 0.5 rad, so the laser must mark x = 30·sin 0.5 mm.
//!
//! ```
//! use isomark::geometry::facing_part::FacingPart;
//! use isomark::geometry::mapping::isometric::IsometricOptions;
//! use isomark::geometry::mapping::{LengthTrueMap, Method, quality};
//! use isomark::geometry::pattern::{Color, Layer, Path, Pattern, Segment, Shape, Source};
//! use isomark::geometry::shapes;
//! use isomark::geometry::space::{FlatPoint, View};
//! use isomark::geometry::surface::fit::{FitOptions, FittedSurface};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! // The part: a mesh that is turned to the laser, sampled and fitted.
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
//! // The map: the cylinder is recognised automatically, and the middle of the drawing keeps its place.
//! let method = Method::Auto {
//!     exact_tolerance: Method::EXACT_TOLERANCE,
//!     otherwise: IsometricOptions::INK,
//! };
//! let map = LengthTrueMap::find(&surface, &drawing, |_| true, FlatPoint::new(0.0, 0.0), &method)?;
//! let end = map.point(FlatPoint::new(15.0, 0.0));
//! assert!((end.x - 30.0 * 0.5f64.sin()).abs() < 1e-3 && end.y.abs() < 1e-3);
//!
//! // On the part, the line has the length that was drawn.
//! let ink = quality::sample(&drawing, |_| true);
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
//! | part, mesh | the object to be marked, and the triangles that describe it |
//! | primitive | a cylinder or cone given by its sizes instead of a mesh |
//! | SKU | the identity of a product; every SKU has a fitted surface |
//! | pattern, drawing | the flat drawing to be marked, in true size |
//! | ink | the lines and inked areas of a drawing that are marked and measured |
//! | ink layer | a layer whose lines are ink |
//! | part frame | the part's own axes, +Z up |
//! | view | the part as the laser sees it: x to the right, y up, z to the laser |
//! | field | the marking software's working area |
//! | height field | heights of the part over a grid of the view; holes and walls stay visible |
//! | surface, knots, span, control net | the NURBS surface that is fitted to the height field, and its elements |
//! | doubt | how far the part may be from the surface, because the file's normals contradict its facets |
//! | residual | the distance between a fit and its data; never called an error |
//! | length-true map | the map from the drawing to the view for which lengths on the part are those drawn |
//! | developable | can be unrolled without stretch: the Gaussian curvature is zero; only then can all lengths be kept |
//! | stretch | length on the part divided by length drawn, minus 1 |
//! | e_l, e_a | length error and area error of a whole drawing, mm and mm² |
//! | chord tolerance | largest distance between a curve and the polyline that replaces it |
//! | bend, corrected drawing | to map a drawing so that it is marked with true lengths, and the result |
//! | bulge, block, layer, OCS | as in DXF |
//! | fixture, lens | the position of the part under the laser, and the projection of the beam |
//! | station | one laser with its folders, field and optics |
//! | hot folder, drop | the folder for input files, and a file that is put there |
//! | job | one pattern on one SKU at one station |
//! | reason, notice | why an input was rejected; a remark that does not stop a job |
//!
//! The code uses millimetres and radians. Settings and reports use degrees; every key names its unit.
//!
//! # Modules in reading order
//!
//! | module | contains | uses |
//! |---|---|---|
//! | [`geometry`] | mathematics only: no file, clock, thread, log or format | – |
//! | [`printable`] | names and messages with non-printing characters escaped | – |
//! | [`reason`] | reasons for rejection, and notices | `printable` |
//! | [`formats`] | bytes to values and back; the only module that uses format crates; opens no file | `geometry`, `printable`, `reason` |
//! | [`config`] | settings files to one validated station and one set of settings for each job | `geometry`, `reason`, `formats` |
//! | [`files`] | files that are written completely or not at all | – |
//! | [`cores`] | halves of a fit or a map at once, in threads | `geometry` |
//! | `converter` | STEP files converted by FreeCAD, in a child process | – |
//! | [`cache`] | fitted surfaces on disk, for each SKU | `geometry`, `formats`, `config`, `files` |
//! | [`preview`] | the pictures of a job: flat, and on the part | `geometry`, `printable`, `formats` |
//! | [`diff`] | the differences between two drawings, as text | `geometry`, `printable` |
//! | [`report`] | the report of one job, in numbers | `geometry`, `printable`, `reason`, `formats`, `cache`, `diff` |
//! | [`report_html`] | the report as a page for people, with the mark on the part in 3-D | `geometry`, `reason`, `formats`, `preview`, `report` |
//! | [`pipeline`] | all stages: read, sample, fit, map, bend, check, write | all above except `files` |
//! | [`Part`], [`Drawing`], [`Settings`], [`Corrector`] | the front door, in `front` | `pipeline`, `config`, `files`, `formats`, `cache`, `preview`, `reason`, `report`, `report_html`, `geometry` |
//! | [`hotfolder`] | the station: folders, queue, journal | `pipeline`, `config`, `files`, `formats`, `cache`, `preview`, `report`, `report_html`, `diff`, `printable`, `reason` |
//! | [`fleet`] | what stations share, in a database | `cache`, `config`, `diff`, `files`, `hotfolder`, `printable`, `reason` |
//! | [`cli`] | the command line | all above |
//!
//! There are no circular dependencies. `tests/layering.rs` reads the sources and checks this, including external
//! crates.
//!
//! # Where to add
//!
//! - **A mesh format**: one file in `src/formats/mesh/` and one variant in
//!   [`MeshFormat`](formats::mesh::MeshFormat); the compiler then reports the places that are missing. Put samples into
//!   `tests/data/parts/` and their true sizes into its `truth.json`.
//! - **A method**: one file in `src/geometry/mapping/` that cites its source, one variant each in
//!   [`mapping::Method`](geometry::mapping::Method) and [`LengthTrueMap`](geometry::mapping::LengthTrueMap), and its
//!   name in [`config::Method`]. Test it with a closed form on one of [`geometry::shapes`].
//! - **A check**: one function in `src/pipeline/checks.rs` or a file in `src/pipeline/checks/` that returns a [`Reason`](reason::Reason) or adds a
//!   [`Notice`](reason::Notice), its code in `src/reason/codes.rs`, and its limit, if it is a setting, in [`config`] and
//!   `watch-config/`.

#[doc(inline)]
pub use isomark_geometry as geometry;
pub mod printable;
pub mod reason;
pub mod formats;
pub mod config;
pub mod files;
pub mod cores;
mod converter;
pub mod cache;
pub mod preview;
pub mod diff;
pub mod report;
pub mod report_html;
pub mod pipeline;
mod front;
#[cfg(feature = "station")]
pub mod hotfolder;
#[cfg(feature = "fleet")]
pub mod fleet;
#[cfg(feature = "cli")]
pub mod cli;

pub use front::{Correction, Corrector, Drawing, Error, Part, Settings, Surface};
