//! What was found in the points of a scan, for reports.

use serde::{Deserialize, Serialize};

use crate::geometry::surface::scan::{ScanQuality, ScanRegion, Smoothing};

/// What was found in the points of a scan, and how they were processed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct ScanFacts {
    /// Number of measured points; those at the place of another do not count.
    pub points: usize,
    /// Number of points that the surface was fitted to.
    pub used: usize,
    /// Number of points below another surface or facing away from the laser.
    pub hidden: usize,
    /// Number of outliers and stray points that were dropped.
    pub dropped: usize,
    /// Distance between points as the laser sees them, mm.
    pub spacing_mm: f64,
    /// Distance between the samples that the surface was fitted to, mm.
    pub grid_step_mm: f64,
    /// How it was smoothed: `auto`, `low-pass` or `none`.
    pub smoothing: String,
    /// The surfaces, separated by cliffs, the one with the most points first.
    pub surfaces: Vec<ScanSurface>,
}

/// One surface of a scan.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct ScanSurface {
    /// Number of points that it was fitted to.
    pub points: usize,
    /// Its bounding rectangle in the view: left, bottom, right, top, mm.
    pub extents_mm: [f64; 4],
    /// Its lowest and highest point, mm.
    pub heights_mm: [f64; 2],
    /// Standard deviation of the points from the surface, mm.
    pub noise_mm: f64,
    /// Wavelength of the low-pass filter, mm: waves of this length are halved, shorter ones removed; absent without
    /// smoothing.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub wavelength_mm: Option<f64>,
    /// Largest departure of the surface from the points that is not explained by noise, mm.
    pub departure_mm: f64,
    /// Where the largest departure is in the view, mm.
    pub departure_at_mm: [f64; 2],
}

impl ScanFacts {
    /// The facts of a smoothed scan.
    pub fn new(quality: &ScanQuality, smoothing: Smoothing) -> Self {
        let name = match smoothing {
            Smoothing::Auto => "auto",
            Smoothing::LowPass { .. } => "low-pass",
            Smoothing::None => "none",
        };
        Self {
            points: quality.points,
            used: quality.used,
            hidden: quality.hidden,
            dropped: quality.dropped,
            spacing_mm: quality.spacing,
            grid_step_mm: quality.step,
            smoothing: name.into(),
            surfaces: quality.regions.iter().map(ScanSurface::new).collect(),
        }
    }
}

impl ScanFacts {
    /// One sentence for people.
    #[must_use]
    pub fn summary(&self) -> String {
        let mut text = format!(
            "a surface was fitted to {} of {} points {:.2} mm apart",
            self.used, self.points, self.spacing_mm
        );
        if self.hidden + self.dropped > 0 {
            text += &format!(" ({} hidden, {} outliers)", self.hidden, self.dropped);
        }
        if let Some(surface) = self.surfaces.first() {
            text += &format!("; they scatter by {:.3} mm", surface.noise_mm);
            if let Some(wavelength) = surface.wavelength_mm {
                text += &format!(", and waves shorter than {wavelength:.1} mm were treated as noise");
            }
        }
        if self.surfaces.len() > 1 {
            text += &format!("; cliffs separate {} surfaces", self.surfaces.len());
        }
        text
    }
}

impl ScanSurface {
    fn new(region: &ScanRegion) -> Self {
        let (min, max) = (region.extents.min, region.extents.max);
        Self {
            points: region.points,
            extents_mm: [min.x, min.y, max.x, max.y],
            heights_mm: region.heights,
            noise_mm: region.noise,
            wavelength_mm: region.wavelength,
            departure_mm: region.departure,
            departure_at_mm: region.departure_at.coords().into(),
        }
    }
}
