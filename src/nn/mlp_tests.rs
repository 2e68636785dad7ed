use super::*;
use crate::simd::{SimdKernel, SimdReal};

/// Outputs of a block, and the derivatives by inputs and parameters of the sum of all outputs times `by_outputs`.
struct Run<'a, T> {
    network: &'a SharedMlp<T>,
    inputs: &'a [T],
    by_outputs: &'a [T],
    outputs: &'a mut Vec<T>,
    by_inputs: &'a mut Vec<T>,
    by_values: &'a mut [T],
}

impl<T: SimdReal> SimdKernel<T> for Run<'_, T> {
    #[inline(always)]
    fn run<S: Simd<Scalar = T>>(self, simd: S) {
        let mut block = MlpBlock::default();
        *self.outputs = block.forward(simd, self.network, self.inputs).to_vec();
        let by = block.backward(simd, self.network, self.inputs, self.by_outputs, self.by_values);
        *self.by_inputs = by.to_vec();
    }
}

struct Derivatives<T> {
    outputs: Vec<T>,
    inputs: Vec<T>,
    values: Vec<T>,
    shared: Vec<T>,
}

fn run<T: SimdReal>(mlp: &Mlp, values: &[T], shared: &[T], inputs: &[T], by_outputs: &[T]) -> Derivatives<T> {
    let network = mlp.with(values, shared);
    let (mut outputs, mut by_inputs) = (Vec::new(), Vec::new());
    let mut by_own = vec![T::zero(); network.parameters()];
    T::dispatch(Run {
        network: &network,
        inputs,
        by_outputs,
        outputs: &mut outputs,
        by_inputs: &mut by_inputs,
        by_values: &mut by_own,
    });
    let (mut by_values, mut by_shared) = (vec![T::zero(); values.len()], vec![T::zero(); shared.len()]);
    mlp.add_gradient(&by_own, values, shared, &mut by_values, &mut by_shared);
    Derivatives { outputs, inputs: by_inputs, values: by_values, shared: by_shared }
}

fn draw<T: Real>(purpose: u64, n: usize) -> Vec<T> {
    let mut rng = CounterRng::new(3, purpose, 0, 0);
    (0..n).map(|_| T::from_f64(0.5 * rng.normal())).collect()
}

#[test]
fn the_gradient_agrees_with_central_differences() {
    let mlp = Mlp { inputs: 5, shared: 3, hidden: vec![11, 9], outputs: 6 };
    let values: Vec<f64> = draw(1, mlp.parameters());
    let (shared, inputs) = (draw::<f64>(2, mlp.shared), draw::<f64>(3, mlp.inputs * BLOCK));
    let by_outputs = draw::<f64>(4, mlp.outputs * BLOCK);
    let loss = |values: &[f64], shared: &[f64], inputs: &[f64]| -> f64 {
        let outputs = run(&mlp, values, shared, inputs, &by_outputs).outputs;
        outputs.iter().zip(&by_outputs).map(|(y, by)| y * by).sum()
    };
    let found = run(&mlp, &values, &shared, &inputs, &by_outputs);
    let check = |name: &str, found: &[f64], at: &dyn Fn(usize, f64) -> f64| {
        let step = 1e-6;
        for k in (0..found.len()).step_by(found.len().div_ceil(60)) {
            let expected = (at(k, step) - at(k, -step)) / (2.0 * step);
            let error = (found[k] - expected).abs() / expected.abs().max(1.0);
            assert!(error < 1e-6, "{name} {k}: {} instead of {expected}", found[k]);
        }
    };
    let moved = |all: &[f64], k: usize, step: f64| {
        let mut all = all.to_vec();
        all[k] += step;
        all
    };
    check("values", &found.values, &|k, d| loss(&moved(&values, k, d), &shared, &inputs));
    check("shared", &found.shared, &|k, d| loss(&values, &moved(&shared, k, d), &inputs));
    check("inputs", &found.inputs, &|k, d| loss(&values, &shared, &moved(&inputs, k, d)));
}

#[test]
fn a_network_starts_with_outputs_of_zero_and_hidden_layers_that_are_not() {
    let mlp = Mlp { inputs: 4, shared: 2, hidden: vec![8], outputs: 3 };
    let values: Vec<f32> = mlp.start(0, 1);
    let by_outputs = vec![1.0; 3 * BLOCK];
    let found = run(&mlp, &values, &[0.3, -0.2], &draw(5, 4 * BLOCK), &by_outputs);
    assert!(found.outputs.iter().all(|y| *y == 0.0));
    assert!(found.values.iter().any(|by| *by != 0.0));
}
