//! The method of the settings, as the map of a drawing takes it.

use crate::config::{self, Aim, JobSettings, Weighting};
use crate::geometry::mapping::Method;
use crate::geometry::mapping::floater::FloaterWeights;
use crate::geometry::mapping::isometric::IsometricOptions;
use crate::geometry::primitive::Form;

/// The method for a drawing, with the weights of its aim.
pub(super) fn method(settings: &JobSettings) -> Method {
    let JobSettings { part, correction, .. } = settings;
    let options = match correction.weighting {
        Weighting::Ink => match correction.aim {
            Aim::Balanced => IsometricOptions::INK,
            Aim::Lengths => IsometricOptions::LENGTHS,
            Aim::Areas => IsometricOptions::AREAS,
            Aim::Shapes => IsometricOptions::SHAPES,
        }
        .emphasised(correction.length_weight, correction.angle_weight),
        Weighting::Uniform => IsometricOptions::UNIFORM,
    };
    match (correction.method, part.primitive.map(|primitive| (primitive, primitive.form()))) {
        (config::Method::Auto, Some((primitive, _)))
        | (config::Method::Cylinder, Some((primitive, Form::Cylinder(_))))
        | (config::Method::Cone, Some((primitive, Form::Cone(_)))) => Method::Given(primitive),
        (config::Method::Auto, None) => {
            Method::Auto { exact_tolerance: Method::EXACT_TOLERANCE, otherwise: options }
        }
        (config::Method::Isometric, _) => Method::Isometric(options),
        (config::Method::Cylinder, _) => Method::Cylinder,
        (config::Method::Cone, _) => Method::Cone,
        (config::Method::MappingDomain, _) => Method::MappingDomain(correction.mapping_domain),
        (config::Method::Floater, _) => Method::Floater(match correction.floater_weights {
            config::FloaterWeights::Uniform => FloaterWeights::Uniform,
            config::FloaterWeights::MeanValue => FloaterWeights::MeanValue,
        }),
        (config::Method::None, _) => Method::Plain,
    }
}
