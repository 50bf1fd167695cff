"""The BSDF of rough interfaces, by what holds of every law: energy and reciprocity."""

from __future__ import annotations

import numpy as np
import pytest

from raymap.laws.rough import RoughLaw


def towards(cosine: float, azimuth: float) -> np.ndarray:
    sine = np.sqrt(1.0 - cosine * cosine)
    return np.array([sine * np.cos(azimuth), sine * np.sin(azimuth), cosine])


@pytest.mark.parametrize(("n_i", "n_o"), [(1.0, 1.5), (1.5, 1.0)])
@pytest.mark.parametrize("cosine", [0.95, 0.4])
def test_all_light_goes_on(n_i: float, n_o: float, cosine: float) -> None:
    nodes, weights = np.polynomial.legendre.leggauss(200)
    angles = (np.arange(128) + 0.5) * 2.0 * np.pi / 128
    wo = np.array([towards(z, a) for z in nodes for a in angles])
    values = RoughLaw(roughness=0.4).bsdf([n_i], [n_o], towards(cosine, 0.0), wo)[0]
    share = np.repeat(weights, len(angles)) * 2.0 * np.pi / 128
    assert (values * np.abs(wo[:, 2]) * share).sum() == pytest.approx(1.0, abs=2e-3)


def test_light_goes_back_as_it_came() -> None:
    law, here, there = RoughLaw(roughness=0.3), towards(0.8, 0.3), towards(0.6, 2.0)
    beyond = there * [1.0, 1.0, -1.0]
    n1, n2 = np.array([1.0, 1.0]), np.array([1.5, 1.6])
    mirrored = law.bsdf(n1, n2, here, there)
    np.testing.assert_allclose(mirrored, law.bsdf(n1, n2, there, here), rtol=1e-12)
    # Seen from the other side, in whose frame both z axes are turned round
    through = law.bsdf(n1, n2, here, beyond)[:, 0]
    back = law.bsdf(n2, n1, -beyond * [-1, -1, 1], here * [1, 1, -1])[:, 0]
    np.testing.assert_allclose(through / n2**2, back / n1**2, rtol=1e-9)


def test_channels_have_indices_of_their_own() -> None:
    law, there = RoughLaw(roughness=0.5), [towards(0.7, 1.0), towards(-0.7, 1.0)]
    both = law.bsdf([1.0, 1.0], [1.4, 1.8], towards(0.9, 0.0), there)
    assert both.shape == (2, 2)
    assert both[1, 0] > both[0, 0] > 0.0
    with pytest.raises(ValueError, match="indices come in pairs"):
        law.bsdf([1.0], [1.4, 1.8], towards(0.9, 0.0), there)
