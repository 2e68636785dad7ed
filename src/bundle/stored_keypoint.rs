//! How the fields of a keypoint are stored that serde has no form for.

/// A position, as column and row.
pub(super) mod px {
    use crate::frame::{CenterPx, Pixel};
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    pub fn serialize<S: Serializer>(px: &Pixel<CenterPx>, to: S) -> Result<S::Ok, S::Error> {
        (px.col, px.row).serialize(to)
    }

    pub fn deserialize<'a, D: Deserializer<'a>>(from: D) -> Result<Pixel<CenterPx>, D::Error> {
        let (col, row) = Deserialize::deserialize(from)?;
        Ok(Pixel::new(col, row))
    }
}

/// A descriptor, as a list of its values.
pub(super) mod descriptor {
    use serde::de::Error;
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    pub fn serialize<S: Serializer, const N: usize>(values: &[f32; N], to: S) -> Result<S::Ok, S::Error> {
        values.as_slice().serialize(to)
    }

    pub fn deserialize<'a, D: Deserializer<'a>, const N: usize>(from: D) -> Result<[f32; N], D::Error> {
        let values = Vec::<f32>::deserialize(from)?;
        values.try_into().map_err(|_| D::Error::custom("a descriptor of another length"))
    }
}
