"""Results of the training, of predictions and of what they take."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class TrainedColors:
    """Figures of the training of colours for any date and sun.

    Attributes:
        iterations: Number of iterations.
        seconds: Time of the iterations, seconds.
        splats: Number of splats at the end.
        l1: Mean absolute difference between rendered and real images (values from 0 to 1).
        ssim: Structural similarity of rendered and real images.
    """

    iterations: int
    seconds: float
    splats: int
    l1: float
    ssim: float


@dataclass(frozen=True)
class Trained:
    """Result of :func:`satgs.train`.

    Attributes:
        iterations: Number of iterations.
        seconds: Time of the iterations, seconds.
        splats_start: Number of splats at the start.
        splats: Number of splats at the end.
        camera_rms_px: Mean over the views of the root mean square distance between camera and RPC, pixels; ``None`` of
            photographs.
        camera_max_px: Largest such distance in any view, pixels.
        l1: Mean absolute difference between rendered and real images (values from 0 to 1); ``None`` without splats.
        ssim: Structural similarity of rendered and real images; ``None`` without splats.
        device: Name of the GPU that trained; ``None`` of the processor.
        colors: Figures of the training of colours that followed; ``None`` of recipes without it.
        was_complete: Whether the run was trained already.
    """

    iterations: int
    seconds: float
    splats_start: int
    splats: int
    was_complete: bool
    camera_rms_px: float | None = None
    camera_max_px: float | None = None
    l1: float | None = None
    ssim: float | None = None
    device: str | None = None
    colors: TrainedColors | None = None


@dataclass(frozen=True)
class CleanUp:
    """What the clean-up of points did.

    Attributes:
        given: Number of points.
        merged: Number of points after those near each other were merged.
        dropped: Number of these that lie far from all others and were dropped.
    """

    given: int
    merged: int
    dropped: int


@dataclass(frozen=True)
class Predicted:
    """Result of :func:`satgs.predict`.

    Attributes:
        points: Where the points come from.
        clean_up: What clean-up left of them.
        spacing_m: Typical distance of the points, metres.
        splats: Number of splats.
        seconds: Seconds from the points to the splats.
        was_complete: Whether the prediction was there already.
    """

    points: str
    clean_up: CleanUp
    spacing_m: float
    splats: int
    seconds: float
    was_complete: bool


@dataclass(frozen=True)
class Validation:
    """Scores on scenes that are not learned from, dB: of the network, of isotropic and of flat splats.

    Attributes:
        dense: With all points.
        sparse: With 5 % of the points.
    """

    dense: tuple[float, float, float]
    sparse: tuple[float, float, float]


@dataclass(frozen=True)
class Learned:
    """Result of :func:`satgs.learn`.

    Attributes:
        model: The file of the model.
        rounds: Number of rounds.
        validation: Scores of the last round that was scored; ``None`` without one.
    """

    model: Path
    rounds: int
    validation: Validation | None


@dataclass(frozen=True)
class NetworkShape:
    """The shape of the network that predicts splats.

    Attributes:
        width: Width of the hidden layers.
        image_features: Number of image features of a key point.
    """

    width: int
    image_features: int


@dataclass(frozen=True)
class NetworkSampling:
    """The points that the network takes.

    Attributes:
        spacing_m: Distance of the splats on level ground, metres.
        key_spacing_m: Distance of the key points, metres.
        densify: Whether splats are sampled in occupied voxels; without it each key point becomes one splat.
        offsets: Whether splats move from where they were sampled.
    """

    spacing_m: float
    key_spacing_m: float
    densify: bool
    offsets: bool


@dataclass(frozen=True)
class WrittenModel:
    """Result of :func:`satgs.learn` with ``start`` and without scenes: what the model is that was written.

    Attributes:
        network: Shape of the network.
        sampling: The points that it takes.
        origin: How the model was made.
        image_network: Hash of the network whose image features it was trained with; ``None`` without one.
    """

    network: NetworkShape
    sampling: NetworkSampling
    origin: str
    image_network: str | None


@dataclass(frozen=True)
class MadePriors:
    """Result of :func:`satgs.prior`.

    Attributes:
        output: Folder of the maps.
        made: Number of maps that were made.
        kept: Number of maps that were there already.
        left_out: Number of images without a map.
    """

    output: Path
    made: int
    kept: int
    left_out: int
