//! Which optional products of its present surface a run has, so that others can be added later.

use super::PipelineError;
use super::run_folder::stage::{Fingerprint, hash};
use crate::io::{read_json, write_json};
use crate::run_files::PRODUCTS;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Product, as it was named → hash of what its surface was made from.
pub(super) struct Products {
    record: PathBuf,
    run: PathBuf,
    made_from: String,
    made: BTreeMap<PathBuf, String>,
}

impl Products {
    /// Those of a run whose surface is made `from` this. Without a readable record there are none.
    pub fn read(run: &Path, from: &Fingerprint) -> Result<Self, PipelineError> {
        let record = run.join(PRODUCTS);
        // Products without a record are made again, which does no harm.
        let made = read_json(&record).unwrap_or_default();
        let from = serde_json::to_string(from)
            .map_err(|source| PipelineError::Json { what: "a fingerprint", source })?;
        Ok(Self { record, run: run.into(), made_from: hash(from.as_bytes()), made })
    }

    /// The products of an earlier surface that are in the run folder. Those elsewhere are their owner's to keep.
    pub fn outdated(&self) -> Vec<PathBuf> {
        let before = self.made.iter().filter(|(_, from)| **from != self.made_from).map(|(path, _)| path);
        before.filter(|path| path.is_relative() && self.run.join(path).exists()).cloned().collect()
    }

    /// All products of a run, of whichever surface.
    pub fn all(run: &Path) -> Vec<PathBuf> {
        let made: BTreeMap<PathBuf, String> = read_json(&run.join(PRODUCTS)).unwrap_or_default();
        made.into_keys().collect()
    }

    /// Whether a product is there, of the present surface.
    pub fn has(&self, product: &Path) -> bool {
        self.made.get(product) == Some(&self.made_from) && self.run.join(product).exists()
    }

    /// Records that a product is written.
    pub fn add(&mut self, product: PathBuf) -> Result<(), PipelineError> {
        self.made.insert(product, self.made_from.clone());
        Ok(write_json(&self.record, &self.made)?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_product_is_there_until_it_is_removed_or_the_surface_is_another() {
        let folder = tempfile::tempdir().unwrap();
        let run = folder.path();
        let from = |cell: &str| Fingerprint::from([("grid".into(), cell.into())]);
        let product = Path::new("dsm.laz");
        let mut products = Products::read(run, &from("0.5 m")).unwrap();
        std::fs::write(run.join(product), "points").unwrap();
        assert!(!products.has(product), "it may be anybody's");
        products.add(product.into()).unwrap();
        assert!(Products::read(run, &from("0.5 m")).unwrap().has(product));
        let other = Products::read(run, &from("1 m")).unwrap();
        assert!(!other.has(product));
        assert_eq!(other.outdated(), [product]);
        assert!(products.outdated().is_empty());
        std::fs::remove_file(run.join(product)).unwrap();
        assert!(!Products::read(run, &from("0.5 m")).unwrap().has(product));
        assert!(other.outdated().is_empty(), "it is gone");
        assert_eq!(Products::all(run), [product]);
    }
}
