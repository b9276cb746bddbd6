//! The pose of the node that all of an OpenCASCADE glTF file hangs on.
//!
//! Programs that convert no vertices turn this node instead. CadQuery and build123d multiply the part's own location by the
//! turn from +Z to +Y from the right: the node's pose is location · turn, and +Y is up only if the location turns about no
//! axis but X.

use nalgebra::{Matrix3, Matrix4, Rotation3, Vector3};

/// Two directions are the same within this, rad.
const SAME_DIRECTION: f64 = 1e-5;

/// A turn and a shift, in the unit and axes of the file.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct RootPose {
    turn: Rotation3<f64>,
    shift: Vector3<f64>,
}

impl RootPose {
    /// `None` if the transform scales, shears or mirrors.
    pub(super) fn of(transform: &Matrix4<f64>) -> Option<Self> {
        let linear = transform.fixed_view::<3, 3>(0, 0).into_owned();
        let is_turn = (linear.transpose() * linear).is_identity(SAME_DIRECTION) && linear.determinant() > 0.0;
        let shift = transform.fixed_view::<3, 1>(0, 3).into_owned();
        is_turn.then(|| Self { turn: Rotation3::from_matrix_unchecked(linear), shift })
    }

    /// Whether it turns the part from +Z to +Y, and not otherwise.
    pub(super) fn sets_upright(&self) -> bool {
        self.location().angle() < SAME_DIRECTION
    }

    /// Whether it shifts the part.
    pub(super) fn is_moved(&self) -> bool {
        self.shift != Vector3::zeros()
    }

    /// Whether the part's +Z stays where it is.
    pub(super) fn keeps_z(&self) -> bool {
        keeps_z(&self.turn)
    }

    /// Whether it is the turn from +Z to +Y of a part that its location turns about Z only.
    pub(super) fn sets_a_turned_part_upright(&self) -> bool {
        keeps_z(&self.location())
    }

    /// A point of the file where it is if the location comes after the turn: +Y is up then, and the part is where its program
    /// has it.
    pub(super) fn relocated(&self, point: Vector3<f64>) -> Vector3<f64> {
        self.relocated_direction(point - self.shift) + upright() * self.shift
    }

    /// The same for a direction.
    pub(super) fn relocated_direction(&self, direction: Vector3<f64>) -> Vector3<f64> {
        if self.sets_upright() {
            return direction;
        }
        upright() * (self.location() * (self.turn.inverse() * direction))
    }

    /// The turn of the part's own location.
    fn location(&self) -> Rotation3<f64> {
        self.turn * upright().inverse()
    }
}

/// The turn from +Z to +Y.
fn upright() -> Rotation3<f64> {
    // Without rounding errors, which a rotation by an angle has.
    Rotation3::from_matrix_unchecked(Matrix3::new(1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, -1.0, 0.0))
}

fn keeps_z(turn: &Rotation3<f64>) -> bool {
    (turn * Vector3::z() - Vector3::z()).norm() < SAME_DIRECTION
}
