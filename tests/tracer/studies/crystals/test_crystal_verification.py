"""The verification suite passes what is right and fails what is wrong."""

from __future__ import annotations

import tomllib

import numpy as np
import pytest

from raymap.model.errors import SceneError
from tracer.studies.crystals.conical_refraction import ConicalScene, conical_checks
from tracer.studies.crystals.crystal_checks import local_checks
from tracer.studies.crystals.crystal_verification import (
    SCENES,
    find_model,
    scene_text,
    verify_crystals,
)
from tracer.studies.crystals.local_model import OutgoingRay, raymap_model


def test_our_local_model_passes():
    failed = [check for check in local_checks(raymap_model) if not check.passed]
    assert failed == []


def test_a_leaking_model_fails():
    def leaking(first, second, refraction_vector, field, normal, wavelength_nm):
        rays = raymap_model(first, second, refraction_vector, field, normal, wavelength_nm)
        return [
            OutgoingRay(
                side=ray.side,
                refraction_vector=ray.refraction_vector,
                direction=ray.direction,
                field=ray.field,
                share=ray.share * (1.0 - 1e-9),
            )
            for ray in rays
        ]

    failed = {check.name for check in local_checks(leaking) if not check.passed}
    assert "energy.binormal" in failed
    assert "snell.energy" in failed
    assert "snell.refraction" not in failed


def test_a_model_that_raises_fails_group_by_group():
    def broken(*arguments):
        raise RuntimeError("no crystals here")

    checks = list(local_checks(broken))
    assert checks
    assert not any(check.passed for check in checks)
    assert "no crystals here" in checks[0].statement


def test_an_independent_model_of_isotropic_media_passes_its_part():
    """Fresnel's formulas written down anew, for another's model through the same door."""

    def fresnel(first, second, refraction_vector, field, normal, wavelength_nm):
        n1 = float(first.principal_indices(wavelength_nm)[0])
        n2 = float(second.principal_indices(wavelength_nm)[0])
        d = np.asarray(refraction_vector) / n1
        ci = float(d @ normal)
        ct = np.sqrt(complex(1.0 - (n1 / n2) ** 2 * (1.0 - ci * ci)))
        s = np.cross(d, -normal)
        s = s / np.linalg.norm(s) if np.linalg.norm(s) > 1e-12 else np.array([0.0, 1.0, 0.0])
        p = np.cross(d, s)
        r_s = (n1 * ci - n2 * ct) / (n1 * ci + n2 * ct)
        r_p = (n2 * ci - n1 * ct) / (n2 * ci + n1 * ct)
        e_s, e_p = field @ s, field @ p
        total = abs(e_s) ** 2 + abs(e_p) ** 2
        back = d - 2.0 * ci * normal
        share = (abs(r_s * e_s) ** 2 + abs(r_p * e_p) ** 2) / total
        rays = []
        if share > 0.0:
            e = r_s * e_s * s + r_p * e_p * np.cross(back, s)
            rays.append(
                OutgoingRay(
                    side="reflected", refraction_vector=n1 * back, direction=back, field=e,
                    share=float(share),
                )
            )  # fmt: skip
        if ct.imag == 0.0 and ct.real > 0.0:
            on = (n1 / n2) * d + (ct.real - (n1 / n2) * ci) * normal
            t_s, t_p = 1.0 + r_s, (1.0 + r_p) * n1 / n2
            e = t_s * e_s * s + t_p * e_p * np.cross(on, s)
            flux = n2 * ct.real / (n1 * ci) * (abs(t_s * e_s) ** 2 + abs(t_p * e_p) ** 2) / total
            rays.append(
                OutgoingRay(
                    side="refracted", refraction_vector=n2 * on, direction=on, field=e,
                    share=float(flux),
                )
            )  # fmt: skip
        return rays

    checks = {check.name: check.passed for check in local_checks(fresnel)}
    own = [name for name in checks if name.split(".")[0] in ("snell", "brewster")]
    assert own
    assert all(checks[name] for name in own)
    assert checks["total_reflection.elliptical"]
    assert not checks["closed_forms.principal_cuts"]


def test_models_and_scenes_are_found_by_name():
    assert find_model("tracer.studies.crystals.local_model:raymap_model") is raymap_model
    for name, message in (
        ("no_colon", "module:function"),
        ("nowhere.at_all:f", "cannot be imported"),
        ("math:pi", "not a function"),
    ):
        with pytest.raises(SceneError, match=message):
            find_model(name)
    with pytest.raises(SceneError, match="scene 'prism' does not exist"):
        list(verify_crystals(scenes=("prism",), numeric=False))
    for name in SCENES:
        if name != "double_image":
            assert tomllib.loads(scene_text(name))


def test_conical_refraction_with_fewer_rays(tmp_path):
    scene = ConicalScene.model_validate(tomllib.loads(scene_text("conical_refraction")))
    scene = scene.model_copy(update={"rays": 60_000})
    failed = [c for c in conical_checks(scene, tmp_path) if not c.passed]
    assert [c.name for c in failed] in ([], ["conical.rotation"])
    assert (tmp_path / "conical_refraction.png").stat().st_size > 1000


@pytest.mark.slow
def test_all_scenes_pass(tmp_path):
    failed = [c for c in verify_crystals(pictures=tmp_path, width=48) if not c.passed]
    assert failed == []
