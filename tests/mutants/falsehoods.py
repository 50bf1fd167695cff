"""What is falsified, and the tests of the features that must notice."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["MUTANTS", "Mutant"]


@dataclass(frozen=True)
class Mutant:
    """A false line in place of a true one, and a test per feature that must fail."""

    name: str
    file: str
    true: str
    false: str
    features: dict[str, str]


_ENGINE = "tests/tracer/transport"
_ANSWERS = "tests/query/answers"

MUTANTS = (
    Mutant(
        name="fresnel",
        file="raymap/optics/fresnel.py",
        true="return a - b, a + b, c - d, c + d",
        false="return 1.2 * (a - b), a + b, c - d, c + d",
        features={
            "rays one by one": f"{_ENGINE}/test_physics.py::"
            "test_plate_reflects_and_transmits_as_the_sum_over_all_reflections_says",
            "streams of rays": "tests/tracer/test_samples.py::"
            "test_lens_over_the_led_reflects_as_fresnel_says",
            "colours after reflection": "tests/tracer/surfaces/test_surfaces.py::"
            "test_dispersive_reflection_keeps_the_expectation_of_each_channel",
            "metals": "tests/raymap/laws/test_stored.py::test_shares_by_hand",
            "rough glass": "tests/tracer/optics/test_microfacet.py::"
            "test_single_facets_agree_with_mitsuba",
            "stated laws": "tests/raymap/laws/test_stored.py::"
            "test_a_quarter_wave_of_the_right_index",
            "polarised light": "tests/tracer/polarized/test_polarized_record.py::"
            "test_light_reflected_at_the_brewster_angle_is_linear",
            "fields": "tests/tracer/optics/test_fresnel_fields.py::test_air_to_glass",
            "lens trees": "tests/tracer/lens/test_reference_tree.py",
            "plates, exact": "tests/tracer/scattering/test_plate_exact.py::"
            "test_reference_table_of_plates",
        },
    ),
    Mutant(
        name="frame about a direction",
        file="raymap/optics/frames.py",
        true="return 1.0 + sign * nx * nx * a, sign * b, -sign * nx, b, sign + ny * ny * a, -ny",
        false="return 1.0 + sign * nx * nx * a, sign * b, -sign * nx, b, sign - ny * ny * a, -ny",
        features={
            "frames": "tests/raymap/optics/test_frames.py::test_a_frame_about_a_direction",
            "directions drawn about another": "tests/tracer/geometry/test_directions.py::"
            "test_directions_keep_length_angle_and_azimuth",
            "retroreflectors": "tests/tracer/optics/test_bsdf.py",
        },
    ),
    Mutant(
        name="frame towards a vector",
        file="raymap/optics/frames.py",
        true="return length, tx, ty, tz, ny * tz - nz * ty, nz * tx - nx * tz, nx * ty - ny * tx",
        false="return length, -tx, ty, tz, ny * tz - nz * ty, nz * tx + nx * tz, nx * ty - ny * tx",
        features={
            "frames": "tests/raymap/optics/test_frames.py::test_s_of_a_plane_of_incidence",
            "fields at faces": "tests/tracer/optics/test_fresnel_fields.py::"
            "test_split_conserves_flux_and_stays_transverse",
            "crystals": "tests/tracer/crystals/test_interface.py",
            "lens trees": "tests/tracer/lens/test_laws.py",
            "scatter about specular light": "tests/tracer/surfaces/test_surfaces.py::"
            "test_abg_scatters_its_share_about_the_specular_direction",
        },
    ),
    Mutant(
        name="record",
        file="tracer/transport/records.py",
        true="real[row, X], real[row, Y], real[row, Z] = x, y, z",
        false="real[row, X], real[row, Y], real[row, Z] = y, x, z",
        features={
            "rays one by one": f"{_ENGINE}/test_engine.py",
            "weighted, split and polarised light": "tests/tracer/run/test_one_run.py::"
            "test_records_lie_where_light_meets_faces",
        },
    ),
    Mutant(
        name="estimator",
        file="raymap/optics/fluxes.py",
        true="np.maximum(sum_w2 - mean, 0.0)",
        false="np.maximum(2.0 * sum_w2 - mean, 0.0)",
        features={
            "answers": f"{_ANSWERS}/test_answers.py::test_flux_and_error_are_those_of_the_formula",
            "table of paths": f"{_ANSWERS}/test_tables.py::test_every_row_selects_its_rays",
            "what rows leave out": f"{_ANSWERS}/test_tables.py::test_the_remainder_makes_it_whole",
            "ghosts": f"{_ANSWERS}/test_tables.py::test_ghosts_by_pair_of_faces",
            "audit": f"{_ANSWERS}/test_tables.py::test_the_audit_closes",
            "illuminated objects": f"{_ANSWERS}/test_tables.py::"
            "test_illuminated_and_critical_objects",
            "sources one by one": f"{_ANSWERS}/test_tables.py::test_sweeps_tell_sources_apart",
            "pictures": f"{_ANSWERS}/test_images.py::test_pictures_are_sums_over_registrations",
            "histograms": f"{_ANSWERS}/test_histograms.py::test_sums_are_those_over_all_rays",
            "sensitivity": f"{_ANSWERS}/what_if/test_sensitivity.py::"
            "test_derivatives_are_those_of_changed_maps",
            "comparison of maps": f"{_ANSWERS}/test_comparison.py",
            "plates": "tests/tracer/scattering/test_goniophotometer.py::"
            "test_reference_table_within_error",
            "scenes on the goniophotometer": "tests/tracer/scattering/"
            "test_scene_goniophotometer.py::test_general_tracer_equals_the_plate_walk",
            "what a trace counts": "tests/tracer/run/test_counts.py::"
            "test_standard_errors_are_the_scatter_of_repeated_traces",
        },
    ),
    Mutant(
        name="length of directions",
        file="raymap/optics/frames.py",
        true="return 1.5 - 0.5 * (x * x + y * y + z * z)",
        false="return 1.5 - 0.499 * (x * x + y * y + z * z)",
        features={
            "directions drawn about another": "tests/tracer/geometry/test_directions.py::"
            "test_directions_keep_length_angle_and_azimuth",
            "lens trees": "tests/tracer/lens/test_reference_tree.py",
            "rays one by one": f"{_ENGINE}/test_physics.py::"
            "test_matched_index_is_invisible_and_keeps_the_direction",
            "colours that part": f"{_ENGINE}/test_physics.py::"
            "test_prism_deviates_by_the_minimum_and_selects_channels_evenly",
            "weighted light": f"{_ENGINE}/test_weighted.py::"
            "test_all_pairs_of_a_coated_lens_are_known",
            "plates": "tests/tracer/scattering/test_goniophotometer.py::"
            "test_cells_agree_with_the_exact_scattering_distribution",
        },
    ),
)
