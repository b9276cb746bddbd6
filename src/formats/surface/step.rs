//! A fitted surface as one face in STEP (ISO 10303-21 clear text, ISO 10303-214): a clamped bicubic B-spline surface
//! and its four border curves, which are B-splines of the net's outer control points.

use std::fmt::{Display, Write};

use nalgebra::{Point3, Vector3};

use crate::geometry::space::View;
use crate::geometry::surface::knots::{DEGREE, UniformKnots};
use crate::geometry::surface::nurbs::NurbsSurface;

pub(super) fn write(surface: &NurbsSurface, view: &View, part: &str) -> Vec<u8> {
    let mut data = Instances::default();
    let (knots_x, knots_y) = surface.knots();
    let columns = knots_x.control_points();
    let net: Vec<Instance> =
        surface.clamped_net().into_iter().map(|point| data.point(view.part_point(point))).collect();
    // STEP lists the control points by u, which is x, and for each u by v.
    let column = |index: usize| list(net.iter().skip(index).step_by(columns));
    let (along_x, along_y) = (knot_list(knots_x), knot_list(knots_y));
    let shape = data.add(&format!(
        "B_SPLINE_SURFACE_WITH_KNOTS('',{DEGREE},{DEGREE},{},.UNSPECIFIED.,.F.,.F.,.F.,{},{},{},{},.UNSPECIFIED.)",
        list((0..columns).map(column)),
        along_x.0,
        along_y.0,
        along_x.1,
        along_y.1
    ));

    let last = net.len() - columns;
    let corners = [net[0], net[columns - 1], net[net.len() - 1], net[last]];
    let vertices = corners.map(|corner| data.add(&format!("VERTEX_POINT('',{corner})")));
    let bottom = data.curve(&net[..columns], &along_x);
    let right: Vec<Instance> = net.iter().skip(columns - 1).step_by(columns).copied().collect();
    let right = data.curve(&right, &along_y);
    let top = data.curve(&net[last..], &along_x);
    let left: Vec<Instance> = net.iter().step_by(columns).copied().collect();
    let left = data.curve(&left, &along_y);
    // Counter-clockwise as the laser sees it; the upper and the left edge run against the direction of their curves.
    let edges = [(bottom, 0, 1, true), (right, 1, 2, true), (top, 3, 2, false), (left, 0, 3, false)].map(
        |(curve, from, to, is_along)| {
            let edge = data.add(&format!("EDGE_CURVE('',{},{},{curve},.T.)", vertices[from], vertices[to]));
            data.add(&format!("ORIENTED_EDGE('',*,*,{edge},{})", if is_along { ".T." } else { ".F." }))
        },
    );
    let edge_loop = data.add(&format!("EDGE_LOOP('',{})", list(edges)));
    let bound = data.add(&format!("FACE_OUTER_BOUND('',{edge_loop},.T.)"));
    let face = data.add(&format!("ADVANCED_FACE('',({bound}),{shape},.T.)"));
    let shell = data.add(&format!("OPEN_SHELL('',({face}))"));
    let model = data.add(&format!("SHELL_BASED_SURFACE_MODEL('',({shell}))"));
    data.product(model, &quoted(part));

    let version = env!("CARGO_PKG_VERSION");
    // A fixed time stamp, so that the same surface gives the same bytes.
    let head = format!(
        "ISO-10303-21;\nHEADER;\nFILE_DESCRIPTION(('surface fitted by isomark, mm'),'2;1');\n\
         FILE_NAME({},'1970-01-01T00:00:00',(''),(''),'isomark {version}','isomark {version}','');\n\
         FILE_SCHEMA(('AUTOMOTIVE_DESIGN {{ 1 0 10303 214 1 1 1 1 }}'));\nENDSEC;\nDATA;\n",
        quoted(part)
    );
    (head + &data.text + "ENDSEC;\nEND-ISO-10303-21;\n").into_bytes()
}

/// The name of an entity instance.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Instance(usize);

impl Display for Instance {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(out, "#{}", self.0)
    }
}

/// The part of the data section that is written so far.
#[derive(Debug, Default)]
struct Instances {
    text: String,
    count: usize,
}

impl Instances {
    fn add(&mut self, entity: &str) -> Instance {
        self.count += 1;
        let name = Instance(self.count);
        // Writing to a string cannot fail.
        let _ = writeln!(self.text, "{name}={entity};");
        name
    }

    fn point(&mut self, at: Point3<f64>) -> Instance {
        self.add(&format!("CARTESIAN_POINT('',{})", reals(at.coords)))
    }

    fn direction(&mut self, towards: Vector3<f64>) -> Instance {
        self.add(&format!("DIRECTION('',{})", reals(towards)))
    }

    fn curve(&mut self, points: &[Instance], (multiplicities, knots): &(String, String)) -> Instance {
        self.add(&format!(
            "B_SPLINE_CURVE_WITH_KNOTS('',{DEGREE},{},.UNSPECIFIED.,.F.,.F.,{multiplicities},{knots},.UNSPECIFIED.)",
            list(points)
        ))
    }

    /// Adds the product whose shape is `model`; STEP readers look for a product.
    fn product(&mut self, model: Instance, name: &str) {
        let origin = self.point(Point3::origin());
        let (axis, right) = (self.direction(Vector3::z()), self.direction(Vector3::x()));
        let frame = self.add(&format!("AXIS2_PLACEMENT_3D('',{origin},{axis},{right})"));
        let length = self.add("(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT(.MILLI.,.METRE.))");
        let angle = self.add("(NAMED_UNIT(*)PLANE_ANGLE_UNIT()SI_UNIT($,.RADIAN.))");
        let solid_angle = self.add("(NAMED_UNIT(*)SI_UNIT($,.STERADIAN.)SOLID_ANGLE_UNIT())");
        let uncertainty = self.add(&format!(
            "UNCERTAINTY_MEASURE_WITH_UNIT(LENGTH_MEASURE(1.E-06),{length},'distance_accuracy_value','')"
        ));
        let context = self.add(&format!(
            "(GEOMETRIC_REPRESENTATION_CONTEXT(3)GLOBAL_UNCERTAINTY_ASSIGNED_CONTEXT(({uncertainty}))\
             GLOBAL_UNIT_ASSIGNED_CONTEXT(({length},{angle},{solid_angle}))REPRESENTATION_CONTEXT('',''))"
        ));
        let shape =
            self.add(&format!("MANIFOLD_SURFACE_SHAPE_REPRESENTATION('',({frame},{model}),{context})"));
        let application =
            self.add("APPLICATION_CONTEXT('core data for automotive mechanical design processes')");
        self.add(&format!(
            "APPLICATION_PROTOCOL_DEFINITION('international standard','automotive_design',2000,{application})"
        ));
        let product_context = self.add(&format!("PRODUCT_CONTEXT('',{application},'mechanical')"));
        let product = self.add(&format!("PRODUCT({name},{name},'',({product_context}))"));
        self.add(&format!("PRODUCT_RELATED_PRODUCT_CATEGORY('part',$,({product}))"));
        let formation = self.add(&format!("PRODUCT_DEFINITION_FORMATION('','',{product})"));
        let design =
            self.add(&format!("PRODUCT_DEFINITION_CONTEXT('part definition',{application},'design')"));
        let definition = self.add(&format!("PRODUCT_DEFINITION('design','',{formation},{design})"));
        let of_product = self.add(&format!("PRODUCT_DEFINITION_SHAPE('','',{definition})"));
        self.add(&format!("SHAPE_DEFINITION_REPRESENTATION({of_product},{shape})"));
    }
}

/// The multiplicities of the knots, and the knots in mm.
fn knot_list(knots: UniformKnots) -> (String, String) {
    let spans = knots.spans();
    let is_end = |knot: usize| knot == 0 || knot == spans;
    let multiplicities = list((0..=spans).map(|knot| if is_end(knot) { DEGREE + 1 } else { 1 }));
    (multiplicities, list((0..=spans).map(|knot| real(knots.start() + knots.step() * knot as f64))))
}

fn list<T: Display>(items: impl IntoIterator<Item = T>) -> String {
    let items: Vec<String> = items.into_iter().map(|item| item.to_string()).collect();
    format!("({})", items.join(","))
}

fn reals(vector: Vector3<f64>) -> String {
    list(vector.iter().copied().map(real))
}

/// A real number, which in STEP always has a decimal point; nine decimals are a millionth of a micrometre.
fn real(value: f64) -> String {
    // Adding zero turns −0 into 0.
    format!("{:.9}", (value * 1e9).round() / 1e9 + 0.0)
}

/// A STEP string, with all characters outside printable ASCII as code points (ISO 10303-21, section 6.3.3).
fn quoted(text: &str) -> String {
    let mut quoted = String::from("'");
    for letter in text.chars() {
        match letter {
            '\'' => quoted += "''",
            '\\' => quoted += "\\\\",
            ' '..='~' => quoted.push(letter),
            _ => {
                let _ = write!(quoted, "\\X4\\{:08X}\\X0\\", u32::from(letter));
            }
        }
    }
    quoted + "'"
}
