"""A user's program as `mypy --strict` sees it; never run, but it would run.

What must be an error carries an ignore comment, and mypy reports comments that nothing needs.
"""

from typing import Any

import numpy as np
from dofsim import (
    SENSORS,
    Aperture,
    DeviceError,
    FocusPicker,
    Lens,
    Scene,
    coc,
    devices,
    focus_pull,
    io,
    metrics,
    plot,
    render,
)
from numpy.typing import NDArray
from typing_extensions import assert_type


def bracket(color: NDArray[np.float32], depth: NDArray[np.float64]) -> NDArray[np.float32]:
    """Use every part of the public interface as its types allow."""
    lens = Lens(aperture_radius=0.05, focus_distance=3.0, fov=42.0, fov_axis="larger")
    for other in (
        Lens.from_camera(focal_length_mm=50, f_number=1.8, focus_distance=float("inf")),
        Lens.from_mitsuba({"type": "thinlens"}),
        Lens.from_blender({"lens": 50.0, "fstop": 2.5, "focus_distance": 4.0}),
        Lens.from_disparity(strength_px=30.0, focus=0.8),
        Lens.from_disparity(strength_percent=3.0, focus=0.8, cat_eye=0.5),
        Lens.from_colmap(fx=500.0, width=640, aperture_radius=0.01, focus_distance=2.0),
        Lens.from_camera(focal_length_mm=50, f_number=2, focus_distance=2.0, sensor="aps-c", breathing=True),
    ):
        known = {lens, other}
        lens = other if len(known) == 1 else lens
    lens = lens.replace(fov=40.0).focused_at(depth, 3, -1, depth_kind="zbuffer", near=0.1, far=10.0)
    if lens.focus_distance is not None and lens.aperture_radius is not None:
        print(lens.aperture_radius / lens.focus_distance, lens.fov_axis)
    lens = lens.replace(tilt=(10.0, 0.0), axial_color=(0.1, 0.0, -0.1), vignetting="natural")
    lens = lens.focused_on(depth, "nearest").focused_on(depth, depth < 2.0)
    lens = lens.focused_on_plane(depth, [(0, 0), (5, 0), (0, 5)])
    assert_type(lens.depth_of_field(0.03), tuple[float, float])
    lens.replace(vignetting="some")  # type: ignore[arg-type]
    lens.replace(colour=1.0)  # type: ignore[call-arg]
    lens.fov = 3.0  # type: ignore[misc]

    hexagon = Aperture(blades=6, rotation=15.0)
    Aperture(image=np.ones((4, 4)), ratio=2.0)
    Aperture.from_blender({"aperture_blades": 5})
    assert_type(hexagon.blades, int)
    assert_type(coc(depth, lens), NDArray[np.float32])
    assert_type(render(color.astype(np.float16), depth, lens), NDArray[np.float16])
    render((255 * color).astype(np.uint8), depth, lens, transfer="srgb")
    render(color, depth, lens, depth_kind="metres")  # type: ignore[call-overload]
    render(color, depth, lens, method="fast")  # type: ignore[call-overload]
    render(color, depth, lens, in_focus=(2.0, 2.6), max_coc_px=200.0, invalid_color="fill")
    render(color, depth, lens, in_focus=2.0)  # type: ignore[call-overload]
    render(color, depth, lens, invalid_color="neighbours")  # type: ignore[call-overload]
    coc(depth, lens.replace(in_focus=(2.0, 2.6)), max_coc_px=9.0)
    Lens(aperture_radius=0.1, fov=40.0, in_focus=(2.0, float("inf")))
    render(color, depth, lens, method="taps", variant="six", hyperfocal_factor=0.3)
    render(color, depth, lens, method="poisson", taps=32, bokeh="ring", leak_test="off")
    render(color, depth, lens, method="poisson", taps=np.zeros((5, 2)), max_coc_px=20.0)
    render(color, depth, lens, method="poisson", leak_test=True)  # type: ignore[call-overload]
    render(color, depth, lens, method="gaussian", focal_range=2.0)
    render(color, depth, lens, method="gaussian", taps=32)  # type: ignore[call-overload]
    render(color, depth, lens, method="taps", variant="eleven")  # type: ignore[call-overload]
    render(color, depth, lens, method="taps", views=128)  # type: ignore[call-overload]
    render(color, depth, lens, method="hexagonal", aperture=hexagon, max_coc_px=32.0)
    render(color, depth, lens, method="levels", c0_px="wide")  # type: ignore[call-overload]
    render(color, depth, lens, method="sprites", sprite=[[0.0, 1.0], [1.0, 0.5]], coc_threshold_px=2)

    scene = Scene(color, depth, device="cpu", supersample=2)
    assert_type(scene.render(lens, aperture=hexagon), NDArray[Any])
    scene.focal_stack(lens, [1.0, 2.0], views=128)
    scene.focal_stack(lens, [1.0, (1.5, 2.0)], max_coc_px=30.0)
    for frame in focus_pull(scene, lens, [(0, 1.0), (24, 3.0)], easing="in", views=128):
        print(frame.shape, SENSORS["aps-c"])
    assert_type(scene.profile(lens, method="gaussian"), list[tuple[str, float]])
    for device in devices():
        if device.kind != "software":
            Scene(color, depth, device=device.id)
    scene.focal_stack(lens, [1.0, 2.0], method="taps", views=128)  # type: ignore[call-overload]
    try:
        picture = render(color, depth, lens, device="gpu")
    except DeviceError:
        picture = render(color, depth, lens, aperture=hexagon, threads=2, overscan=8)
    print(metrics.psnr(picture, color), io.read_color("picture.exr").pixels.dtype)
    picker = FocusPicker(color, depth, lens, aperture=hexagon, depth_kind="z", transfer=None)
    picker.focus_at(3, 4)
    assert_type(picker.render(), NDArray[np.float32])
    FocusPicker(color, depth, lens, transfer="gamma")  # type: ignore[arg-type]

    plot.coc(depth, lens, depth_kind="distance").savefig("coc.png")
    plot.compare(picture, color, masks=metrics.regions(coc(depth, lens)), border=8)
    plot.depth_of_field(lens, sharp_radius_px="wide")  # type: ignore[arg-type]
    print(lens._repr_html_(), hexagon._repr_png_()[:4])
    return picture
