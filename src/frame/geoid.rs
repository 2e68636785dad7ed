//! Heights of geoids above the ellipsoid, interpolated by PROJ from grid files.

use super::FrameError;
use super::crs::wrap_longitude_deg;
use super::proj_log;
use proj::Proj;
use std::cell::RefCell;
use std::collections::BTreeMap;
use std::path::Path;

/// The grid of a geoid model.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct GeoidGrid {
    /// PROJ pipeline from (longitude, latitude) in degrees to (undulation in metres, latitude in radians).
    pipeline: String,
}

thread_local! {
    /// PROJ objects of this thread; they cannot be shared between threads, and creating one reads the header of the grid.
    static CACHE: RefCell<BTreeMap<String, Option<Proj>>> = const { RefCell::new(BTreeMap::new()) };
}

impl GeoidGrid {
    /// Opens a grid in a format of PROJ: `.gtx`, or a GeoTIFF in degrees.
    ///
    /// # Errors
    /// [`FrameError::GeoidGrid`] when PROJ cannot read it.
    pub fn open(path: &Path) -> Result<Self, FrameError> {
        let refused = || FrameError::GeoidGrid { path: path.into() };
        let file = path.canonicalize().ok().and_then(|file| file.to_str().map(str::to_owned));
        file.and_then(|file| Self::read(&file)).ok_or_else(refused)
    }

    /// A grid that PROJ knows by the name of its file: in its data folders, or in the library.
    #[must_use]
    pub fn of_proj(name: &str) -> Option<Self> {
        Self::read(name)
    }

    fn read(file: &str) -> Option<Self> {
        // PROJ would take a comma for a separator of several grids.
        if file.contains([',', '"']) {
            return None;
        }
        // The `proj` crate returns x and y only, so that the pipeline moves the height to x.
        let pipeline = format!(
            "+proj=pipeline +step +proj=unitconvert +xy_in=deg +xy_out=rad \
             +step +proj=vgridshift +grids=\"{file}\" +multiplier=1 +step +proj=axisswap +order=3,2,1"
        );
        let grid = Self { pipeline };
        grid.with_proj(|proj| proj.is_some()).then_some(grid)
    }

    /// Height of the geoid above the ellipsoid at a place in degrees, metres, interpolated bilinearly; NaN outside of the
    /// grid.
    ///
    /// `ellipsoidal height = orthometric height + undulation`.
    #[must_use]
    pub fn undulation_m(&self, lon_deg: f64, lat_deg: f64) -> f64 {
        if !(-90.0..=90.0).contains(&lat_deg) {
            return f64::NAN;
        }
        let place = (wrap_longitude_deg(lon_deg), lat_deg);
        self.with_proj(|proj| proj.and_then(|p| p.convert(place).ok())).map_or(f64::NAN, |(up, _)| up)
    }

    fn with_proj<T>(&self, f: impl FnOnce(Option<&Proj>) -> T) -> T {
        CACHE.with_borrow_mut(|cache| {
            if !cache.contains_key(&self.pipeline) {
                proj_log::silence();
                cache.insert(self.pipeline.clone(), Proj::new(&self.pipeline).ok());
            }
            f(cache.get(&self.pipeline).and_then(Option::as_ref))
        })
    }
}
