//! A second run on the page of a first one, behind a divider.

use super::page::Comparison;
use super::{ViewerError, ViewerPage};

/// What names of the second run's files begin with.
const PREFIX: &str = "other-";

impl ViewerPage {
    /// Compares with the run of another page, whose files this one gets.
    ///
    /// # Errors
    /// [`ViewerError::OtherMap`] if their coordinates refer to different maps.
    pub fn compare(&mut self, other: Self) -> Result<(), ViewerError> {
        if self.frame != other.frame {
            let [first, second] = [&self.frame, &other.frame].map(|frame| match frame.as_str() {
                "" => "no map".into(),
                frame => frame.to_owned(),
            });
            return Err(ViewerError::OtherMap { first, second });
        }
        let offset = [0, 1, 2].map(|k| other.origin[k] - self.origin[k]);
        let Self { title, layers, files, .. } = other;
        self.files.extend(files.into_iter().map(|mut file| {
            file.name = format!("{PREFIX}{}", file.name).into();
            file
        }));
        self.other = Some(Comparison { title, offset, prefix: PREFIX, layers });
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::{PageFile, PageScope};
    use super::*;
    use crate::frame::{Point, SiteGrid};

    fn page(epsg: u32, east: f64) -> ViewerPage {
        let site = SiteGrid { epsg, origin: Point::new(east, 3_357_611.0, -20.0) };
        let scope = PageScope::of_area((-1.0, -1.0, 1.0, 1.0));
        let mut page = ViewerPage::new(format!("run at {east}"), Some(&site), scope);
        page.files.push(PageFile::new("points.bin", vec![1]));
        page
    }

    #[test]
    fn a_second_run_stands_where_it_is_on_the_map() {
        let mut first = page(32617, 436_211.0);
        first.compare(page(32617, 436_200.5)).unwrap();
        assert_eq!(first.other.as_ref().map(|o| o.offset), Some([-10.5, 0.0, 0.0]));
        let names: Vec<_> = first.files.iter().map(|f| f.name.as_ref()).collect();
        assert_eq!(names, ["points.bin", "other-points.bin"]);
    }

    #[test]
    fn runs_on_different_maps_are_not_compared() {
        let error = page(32617, 436_211.0).compare(page(32618, 1.0)).unwrap_err();
        assert!(error.to_string().contains("EPSG:32618"), "{error}");
    }
}
