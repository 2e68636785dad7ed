use super::*;
use crate::random::CounterRng;

fn draw<T: Real>(purpose: u64, n: usize) -> Vec<T> {
    let mut rng = CounterRng::new(3, purpose, 0, 0);
    (0..n).map(|_| T::from_f64(0.5 * rng.normal())).collect()
}

fn blocks<T: Real>(purpose: u64, features: usize, items: usize) -> FeatureBlocks<T> {
    let values = draw::<T>(purpose, features * items);
    let mut out = FeatureBlocks::zeros(features, items);
    (0..features * items).for_each(|i| *out.at_mut(i / items, i % items) = values[i]);
    out
}

/// 40 key points and 700 queries, more than a block.
fn input<T: Real>(network: &SplatNetwork) -> NetworkInput<T> {
    let (keys, queries) = (40, 700);
    let mut rng = CounterRng::new(3, 9, 0, 0);
    let near = |_| std::array::from_fn(|_| rng.below(keys) as u32);
    let relative = draw::<T>(7, queries * NEIGHBOURS * 3);
    let relative = relative.chunks(3 * NEIGHBOURS);
    NetworkInput {
        members: blocks(4, MEMBER_INPUTS, keys * GROUP),
        keys: blocks(5, KEY_INPUTS + network.image_features, keys),
        neighbours: (0..queries).map(near).collect(),
        relative: relative.map(|r| std::array::from_fn(|n| [r[3 * n], r[3 * n + 1], r[3 * n + 2]])).collect(),
        queries: blocks(6, QUERY_INPUTS, queries),
    }
}

fn loss<T: SimdReal>(
    network: &SplatNetwork,
    values: &[T],
    input: &NetworkInput<T>,
    by: &FeatureBlocks<T>,
) -> f64 {
    let mut evaluation = NetworkEvaluation::new(network);
    let out = evaluation.forward(values, input);
    let item = |i: usize| (0..OUTPUTS).map(|k| (out.at(k, i) * by.at(k, i)).as_f64()).sum::<f64>();
    (0..out.items()).map(item).sum()
}

#[test]
fn the_gradient_of_every_layer_agrees_with_central_differences() {
    let network = SplatNetwork { width: 8, image_features: 3 };
    let values: Vec<f64> = draw(1, network.parameters());
    let (input, by) = (input::<f64>(&network), blocks::<f64>(2, OUTPUTS, 700));
    let mut evaluation = NetworkEvaluation::new(&network);
    evaluation.forward(&values, &input);
    let mut gradient = vec![0.0; values.len()];
    evaluation.backward(&values, &input, &by, &mut gradient);
    let scale = gradient.iter().map(|v| v * v).sum::<f64>().sqrt() / (values.len() as f64).sqrt();
    let parts = network.parts();
    let last = parts.of_decays.start;
    for i in (0..last).step_by(7).chain(last..values.len()) {
        let at = |by_step: f64| {
            let mut moved = values.clone();
            moved[i] += by_step;
            loss(&network, &moved, &input, &by)
        };
        let step = 1e-6;
        let expected = (at(step) - at(-step)) / (2.0 * step);
        let error = (gradient[i] - expected).abs();
        assert!(error < 1e-6 * (expected.abs() + scale), "{i}: {} {expected}", gradient[i]);
    }
}

#[test]
fn outputs_are_zero_at_the_start_and_gradients_do_not_depend_on_threads() {
    let network = SplatNetwork { width: 16, image_features: 2 };
    let (input, by) = (input::<f32>(&network), blocks::<f32>(2, OUTPUTS, 700));
    let start: Vec<f32> = network.start(1);
    assert_eq!(loss(&network, &start, &input, &by), 0.0);
    let values: Vec<f32> = draw(1, network.parameters());
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let mut evaluation = NetworkEvaluation::new(&network);
            let out = evaluation.forward(&values, &input).clone();
            let mut gradient = vec![0.0; values.len()];
            evaluation.backward(&values, &input, &by, &mut gradient);
            (out, gradient)
        })
    };
    assert_eq!(with(1), with(3));
}
