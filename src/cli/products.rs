//! Which products beside the rasters a run has of its present surface, so that others can be added later.

use super::Failure;
use super::run_folder::write_json;
use super::stage::{Fingerprint, hash};
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
    /// Those of a run whose surface is made `from` this. Without a sound record there are none.
    pub fn read(run: &Path, from: &Fingerprint) -> Self {
        let record = run.join(PRODUCTS);
        let text = std::fs::read_to_string(&record).unwrap_or_default();
        let made = serde_json::from_str(&text).unwrap_or_default();
        let made_from = hash(serde_json::to_string(from).unwrap_or_default().as_bytes());
        Self { record, run: run.into(), made_from, made }
    }

    /// Whether a product is there, of the present surface.
    pub fn has(&self, product: &Path) -> bool {
        self.made.get(product) == Some(&self.made_from) && self.run.join(product).exists()
    }

    /// Records that a product is written.
    pub fn add(&mut self, product: PathBuf) -> Result<(), Failure> {
        self.made.insert(product, self.made_from.clone());
        write_json(&self.record, &self.made)
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
        let mut products = Products::read(run, &from("0.5 m"));
        std::fs::write(run.join(product), "points").unwrap();
        assert!(!products.has(product), "it may be anybody's");
        products.add(product.into()).unwrap();
        assert!(Products::read(run, &from("0.5 m")).has(product));
        assert!(!Products::read(run, &from("1 m")).has(product));
        std::fs::remove_file(run.join(product)).unwrap();
        assert!(!Products::read(run, &from("0.5 m")).has(product));
    }
}
