//! Damaged files of weights.

use super::{Backbone, Lpips, LpipsError};
use safetensors::Dtype;
use safetensors::tensor::TensorView;
use std::path::Path;

/// The first convolution of AlexNet.
const FIRST: &str = "features.0.weight";
const FIRST_SHAPE: [usize; 4] = [64, 3, 11, 11];
const FIRST_LEN: usize = 64 * 3 * 11 * 11;

/// A tensor of a file: name, type, shape, bytes.
type Stored<'a> = (&'a str, Dtype, &'a [usize], Vec<u8>);

fn file(tensors: &[Stored<'_>]) -> Vec<u8> {
    let views = tensors
        .iter()
        .map(|(name, kind, shape, bytes)| (*name, TensorView::new(*kind, shape.to_vec(), bytes).unwrap()));
    safetensors::serialize(views, None).unwrap()
}

fn first_weights() -> Stored<'static> {
    (FIRST, Dtype::F32, &FIRST_SHAPE, vec![0; 4 * FIRST_LEN])
}

/// The error of reading a file of these bytes; its text and hint name the file.
fn error(bytes: &[u8]) -> LpipsError {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("weights.safetensors");
    std::fs::write(&path, bytes).unwrap();
    let error = Lpips::<f32>::read(&path).err().unwrap();
    assert!(error.to_string().contains("weights.safetensors"), "{error}");
    assert!(miette::Diagnostic::help(&error).is_some());
    error
}

#[test]
fn files_that_are_absent_or_damaged_are_refused() {
    let absent = Lpips::<f32>::read(Path::new("/nowhere/weights.safetensors")).err().unwrap();
    assert!(matches!(absent, LpipsError::Read { .. }));
    let whole = file(&[first_weights()]);
    for bytes in [&[][..], b"no weights at all", &whole[..whole.len() - 1], &whole[..20]] {
        assert!(matches!(error(bytes), LpipsError::Format { .. }));
    }
}

#[test]
fn tensors_that_are_absent_or_wrong_are_named() {
    let missing = |tensors: &[Stored<'_>]| match error(&file(tensors)) {
        LpipsError::Missing { tensor, backbone, .. } => (tensor, backbone),
        other => panic!("{other}"),
    };
    assert_eq!(missing(&[]), (FIRST.into(), None));
    assert_eq!(missing(&[first_weights()]), ("features.0.bias".into(), Some(Backbone::AlexNet)));
    let bias = ("features.0.bias", Dtype::F32, &[64][..], vec![0; 4 * 64]);
    assert_eq!(missing(&[first_weights(), bias]).0, "lin0.model.1.weight");

    let seven = (FIRST, Dtype::F32, &[64, 3, 7, 7][..], vec![0; 4 * 64 * 3 * 49]);
    assert!(matches!(error(&file(&[seven])), LpipsError::Backbone { found, .. } if found == [64, 3, 7, 7]));

    let bias = ("features.0.bias", Dtype::F32, &[63][..], vec![0; 4 * 63]);
    let wrong = error(&file(&[first_weights(), bias]));
    assert!(matches!(wrong, LpipsError::Shape { tensor, found, expected, .. }
        if tensor == "features.0.bias" && found == [63] && expected == [64]));

    let doubles = (FIRST, Dtype::F64, &FIRST_SHAPE[..], vec![0; 8 * FIRST_LEN]);
    assert!(matches!(error(&file(&[doubles])), LpipsError::Type { found, .. } if found == "F64"));

    let (_, kind, shape, mut bytes) = first_weights();
    bytes[4 * 5..4 * 6].copy_from_slice(&f32::NAN.to_le_bytes());
    let wrong = error(&file(&[(FIRST, kind, shape, bytes)]));
    assert!(matches!(wrong, LpipsError::NotFinite { tensor, index: 5, .. } if tensor == FIRST));
}
