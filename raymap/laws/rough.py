"""Rough interfaces of microscopic facets: nothing is absorbed, each facet obeys Fresnel."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field

from raymap.jit.kernels import lean_kernel
from raymap.laws.microfacet import eval_rough_dielectric
from raymap.laws.microfacet_losses import dielectric_table
from raymap.laws.smooth import FresnelLaw

__all__ = ["RoughLaw"]

F64 = NDArray[np.float64]


class RoughLaw(FresnelLaw):
    """GGX facets of a roughness (alpha); its shares are those of a facet."""

    law: Literal["rough"] = "rough"  # type: ignore[assignment]
    roughness: Annotated[float, Field(gt=0.0)]

    def bsdf(self, n_i: ArrayLike, n_o: ArrayLike, wi: ArrayLike, wo: ArrayLike) -> F64:
        """BSDF of flux: light of unit flux sends bsdf · |wo_z| per solid angle.

        Parameters
        ----------
        n_i, n_o : (n_channels,) indices on the incident side and beyond
        wi : (3,) unit vector back along the light, in a frame whose z is the normal on its side
        wo : (n, 3) unit vectors along which light goes on; z below 0: through

        Returns
        -------
        (n_channels, n) [1/sr], with the light that meets several facets
            (`raymap.laws.microfacet`)
        """
        inside, beyond = (np.atleast_1d(np.asarray(values, np.float64)) for values in (n_i, n_o))
        light = np.asarray(wi, np.float64)
        on = np.atleast_2d(np.asarray(wo, np.float64))
        if inside.shape != beyond.shape or light.shape != (3,) or on.shape[1:] != (3,):
            raise ValueError("indices come in pairs, directions as vectors of three components")
        found = np.empty((len(inside), len(on)))
        _fill(dielectric_table(self.roughness), self.roughness, inside, beyond, light, on, found)
        return found


@lean_kernel
def _fill(table: F64, alpha: float, n_i: F64, n_o: F64, wi: F64, wo: F64, found: F64) -> None:
    for channel in range(len(n_i)):
        for k in range(len(wo)):
            found[channel, k] = eval_rough_dielectric(
                table, 0, wi[0], wi[1], wi[2], wo[k, 0], wo[k, 1], wo[k, 2], alpha,
                n_i[channel], n_o[channel],
            )  # fmt: skip
