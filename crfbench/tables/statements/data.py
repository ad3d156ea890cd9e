"""What the paper says of its two data sets."""

from crfbench.curves import N_SAMPLES
from crfbench.tables.evidence import Evidence
from crfbench.tables.statements.finding import Check, Finding, counted


def responses(evidence: Evidence) -> Finding:
    """Count the curves of DoRF."""
    n = int(evidence.copies["curves"].item())
    return counted("responses", n, "crfbench.datasets.load_dorf", "Counted in the file.")


def cameras_of_dorf(evidence: Evidence) -> Finding:
    """Count what the curves of DoRF were measured on."""
    row = evidence.copies.iloc[0]
    why = (
        f"{row['not_alone']} of the {row['curves']} curves have another within an RMSE of 0.01: layers of one film, "
        "channels of one camera, copies; many are films."
    )
    return counted("cameras_of_dorf", int(row["groups"]), "crfbench.tables.evidence.near_copy_counts", why)


def samples(evidence: Evidence) -> Finding:
    """Compare the grid."""
    return counted("samples", N_SAMPLES, "crfbench.datasets.load_dorf", "Every file with another number is refused.")


def camera_count(evidence: Evidence) -> Finding:
    """Count cameras."""
    return _patch_count(evidence, "camera_count", ["camera"])


def photographs(evidence: Evidence) -> Finding:
    """Count photographs."""
    return _patch_count(evidence, "photographs", ["camera", "illumination", "exposure"])


def photographs_each(evidence: Evidence) -> Finding:
    """Count the photographs of each camera."""
    return _patch_count(evidence, "photographs_each", ["illumination", "exposure"])


def illuminations(evidence: Evidence) -> Finding:
    """Count illuminations."""
    return _patch_count(evidence, "illuminations", ["illumination"])


def exposures(evidence: Evidence) -> Finding:
    """Count exposures."""
    return _patch_count(evidence, "exposures", ["exposure"])


def patches(evidence: Evidence) -> Finding:
    """Count patches."""
    return _patch_count(evidence, "patches", ["patch"])


def _patch_count(evidence: Evidence, key: str, columns: list[str]) -> Finding:
    n = len(evidence.patches[columns].drop_duplicates())
    return counted(key, n, "crfbench.datasets.load_patches", "Counted in the patch table.")


def uniform_channels(evidence: Evidence) -> Finding:
    """Say what would be needed."""
    why = "The cameras that were not taken are not in the published set."
    return Finding("–", "crfbench.datasets.load_patches", "not comparable", why)


CHECKS: dict[str, Check] = {
    "responses": responses,
    "cameras_of_dorf": cameras_of_dorf,
    "samples": samples,
    "camera_count": camera_count,
    "photographs": photographs,
    "photographs_each": photographs_each,
    "illuminations": illuminations,
    "exposures": exposures,
    "patches": patches,
    "uniform_channels": uniform_channels,
}
