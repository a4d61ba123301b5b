"""The transform and the data set for PyTorch."""

import dofsim
import numpy as np
import pytest

torch = pytest.importorskip("torch")
tv_tensors = pytest.importorskip("torchvision.tv_tensors")
v2 = pytest.importorskip("torchvision.transforms.v2")

from dofsim._relative import range_of  # noqa: E402
from dofsim.torch import Depth, DepthOfField, RandomDepthOfField, render  # noqa: E402

LENS = dofsim.Lens(aperture_radius=0.01, focus_distance=1.0, fov=40.0)


@pytest.fixture
def sample():
    generator = torch.Generator().manual_seed(3)
    image = tv_tensors.Image(torch.rand(3, 24, 32, generator=generator))
    return {"image": image, "depth": Depth(torch.rand(24, 32, generator=generator) + 1.0), "label": 7}


def blur(**options):
    return RandomDepthOfField(LENS, **{"max_coc_px": (2.0, 8.0), **options})


def test_it_is_render_with_the_lens_that_was_drawn(sample):
    transform = blur(method="poisson", taps=20)
    torch.manual_seed(5)
    lens = transform.draw(sample["depth"])
    torch.manual_seed(5)
    out = transform(sample)
    expected = dofsim.render(
        sample["image"].numpy().transpose(1, 2, 0), sample["depth"].numpy(), lens, method="poisson", taps=20
    )
    np.testing.assert_array_equal(out["image"].numpy().transpose(1, 2, 0), expected)
    assert type(out["image"]) is tv_tensors.Image
    assert torch.equal(out["depth"], sample["depth"])
    assert out["label"] == 7


def test_the_largest_radius_is_in_range_and_varies(sample):
    transform = blur(depth_to="coc", max_coc_px=(3.0, 5.0))
    radii = [float(transform(sample)["depth"].abs().max()) for _ in range(20)]
    assert 3.0 - 1e-4 <= min(radii) < 3.5
    assert 4.5 < max(radii) <= 5.0 + 1e-4


def test_the_focus_is_a_random_pixel(sample):
    transform = blur(depth_to="coc")
    sharp = {int(transform(sample)["depth"].abs().argmin()) for _ in range(10)}
    assert len(sharp) > 5


def test_a_range_in_focus_stays_and_the_opening_is_drawn(sample):
    transform = blur(depth_to="coc", max_coc_px=(4.0, 4.0), in_focus=(1.2, 1.4))
    radius, depth = transform(sample)["depth"].numpy(), sample["depth"].numpy()
    inside = (depth > 1.2) & (depth < 1.4)
    assert (radius[inside] == 0.0).all()
    assert np.abs(radius).max() == pytest.approx(4.0, abs=1e-4)
    assert (np.sign(radius[~inside]) == np.sign(depth[~inside] - 1.3)).all()


def test_closed_is_the_identity(sample):
    assert torch.equal(blur(max_coc_px=(0.0, 0.0))(sample)["image"], sample["image"])


def test_relative_disparity(sample):
    lens = dofsim.Lens.from_disparity(strength_px=1.0, focus=0.0)
    transform = RandomDepthOfField(lens, max_coc_px=(4.0, 4.0), depth_to="coc", depth_kind="disparity")
    signed = {**sample, "depth": Depth(sample["depth"] - 1.5)}
    assert float(transform(signed)["depth"].abs().max()) == pytest.approx(4.0)


@pytest.mark.parametrize("strength", [{"strength_px": 1.0}, {"strength_percent": 2.0}])
def test_disparity_of_any_sign_and_strength_of_any_unit(sample, strength):
    lens = dofsim.Lens.from_disparity(**strength, focus=0.0)
    transform = RandomDepthOfField(lens, max_coc_px=(4.0, 4.0), depth_to="coc", depth_kind="relative")
    negative = {**sample, "depth": Depth(-sample["depth"])}
    assert float(transform(negative)["depth"].abs().max()) == pytest.approx(4.0)


def test_the_background_of_inverse_depth_is_not_focused_on(sample):
    depth = torch.zeros(24, 32)
    depth[3, 5] = 0.5
    lens = blur(depth_kind="inverse_z").draw(Depth(depth))
    assert lens.focus_distance == pytest.approx(2.0)


@pytest.mark.parametrize("dtype", [torch.float16, torch.float32, torch.float64, torch.uint8])
def test_types_are_kept(sample, dtype):
    scale = 255 if dtype == torch.uint8 else 1
    image = tv_tensors.Image((sample["image"] * scale).to(dtype))
    out = blur()({**sample, "image": image})["image"]
    assert (out.dtype, out.shape) == (dtype, image.shape)
    assert not torch.equal(out, image)


@pytest.mark.parametrize("channel", [(), (1,)])
def test_each_picture_of_a_batch_has_a_lens_of_its_own(sample, channel):
    images = tv_tensors.Image(torch.stack([sample["image"]] * 4))
    depths = Depth(torch.stack([sample["depth"]] * 4).reshape(4, *channel, 24, 32))
    transform = blur(max_coc_px=(2.0, 9.0), depth_to="coc", lens_to="lens")
    out = transform({"image": images, "depth": depths})
    assert out["image"].shape == images.shape
    assert out["depth"].shape == depths.shape
    focus, radius = out["lens"]["focus_distance"], out["lens"]["aperture_radius"]
    assert focus.shape == radius.shape == (4,)
    assert len(set(focus.tolist())) > 1
    for index in range(4):
        lens = LENS.replace(focus_distance=float(focus[index]), aperture_radius=float(radius[index]))
        expected = dofsim.coc(sample["depth"].numpy(), lens)
        np.testing.assert_array_equal(out["depth"][index].numpy().reshape(24, 32), expected)
        picture = dofsim.render(sample["image"].numpy().transpose(1, 2, 0), sample["depth"].numpy(), lens)
        np.testing.assert_array_equal(out["image"][index].numpy().transpose(1, 2, 0), picture)


def test_the_lens_that_was_drawn_is_in_the_sample(sample):
    transform = blur(lens_to="lens", depth_to="coc")
    out = transform(sample)
    assert set(out) == {*sample, "lens"}
    lens = LENS.replace(**out["lens"])
    np.testing.assert_array_equal(out["depth"].numpy(), dofsim.coc(sample["depth"].numpy(), lens))
    # What a data loader makes of several.
    both = torch.utils.data.default_collate([transform(sample), transform(sample)])
    assert both["lens"]["focus_distance"].shape == (2,)
    with pytest.raises(TypeError, match="must be a dictionary"):
        transform((sample["image"], sample["depth"]))


def test_depth_may_have_a_channel(sample):
    torch.manual_seed(5)
    expected = blur()(sample)["image"]
    torch.manual_seed(5)
    assert torch.equal(blur()({**sample, "depth": Depth(sample["depth"][None])})["image"], expected)


def test_gradients_are_warned_of(sample):
    image = tv_tensors.Image(sample["image"].as_subclass(torch.Tensor), requires_grad=True)
    with pytest.warns(UserWarning, match="passes no gradients"):
        blur()({**sample, "image": image})


def test_transforms_and_data_sets_show_their_arguments():
    transform = blur(depth_kind="distance", method="poisson")
    text = repr(DepthOfField([], transform, seed=3))
    for part in (repr(LENS), "max_coc_px=(2.0, 8.0)", "depth_kind='distance'", "method='poisson'", "seed=3"):
        assert part in text


def test_tensors_are_not_copied(sample, monkeypatch):
    seen = []

    def render(color, depth, lens, **_):
        seen.extend(array.__array_interface__["data"][0] for array in (color, depth))
        return color

    monkeypatch.setattr(dofsim, "render", render)
    out = blur()(sample)
    assert seen == [sample["image"].data_ptr(), sample["depth"].data_ptr()]
    assert out["image"].data_ptr() == sample["image"].data_ptr()


def test_other_transforms_take_depth_for_what_it_is(sample):
    out = v2.Compose([v2.RandomHorizontalFlip(1.0), v2.CenterCrop(16), blur()])(sample)
    assert type(out["depth"]) is Depth
    assert torch.equal(out["depth"], sample["depth"].flip(-1)[4:20, 8:24])


def test_an_index_is_the_same_picture_with_any_number_of_workers(sample):
    plain = (sample["image"].as_subclass(torch.Tensor), sample["depth"])
    data = DepthOfField([plain] * 6, blur(), seed=4)
    torch.manual_seed(1)
    expected = [data[i][0] for i in range(6)]
    torch.manual_seed(2)
    before = torch.get_rng_state()
    assert torch.equal(data[-1][0], expected[-1])
    assert torch.equal(torch.get_rng_state(), before)
    assert not torch.equal(expected[0], expected[1])
    for workers in (0, 2):
        loader = torch.utils.data.DataLoader(data, batch_size=None, num_workers=workers)
        for (picture, _), one in zip(loader, expected, strict=True):
            assert torch.equal(picture, one)
    data.set_epoch(1)
    assert not torch.equal(data[0][0], expected[0])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"depth": 3.0}, "one dofsim.torch.Depth and one picture; got 0 and 1"),
        ({"image": "none"}, "one dofsim.torch.Depth and one picture; got 1 and 0"),
        ({"depth": Depth(torch.full((24, 32), torch.inf))}, "no pixel to focus on"),
        ({"depth": Depth(torch.ones(24, 31))}, "the picture must have shape"),
    ],
)
def test_samples_that_are_none(sample, change, message):
    with pytest.raises(ValueError, match=message):
        blur()({**sample, **change})


@pytest.mark.parametrize(
    "options", [{"max_coc_px": (3.0, 2.0)}, {"max_coc_px": (-1.0, 2.0)}, {"depth_to": "disparity"}]
)
def test_words_that_are_none(options):
    with pytest.raises(ValueError, match=next(iter(options))):
        blur(**options)


def test_pictures_of_a_clip_have_one_scale_of_relative_depth():
    lens = dofsim.Lens.from_disparity(strength_percent=3.0, focus=1.0)
    depth = torch.linspace(3.0, 9.0, 24 * 32).reshape(1, 24, 32).repeat(2, 1, 1)
    depth[1, :8, :8] = 90.0
    clip = {"image": tv_tensors.Image(torch.rand(2, 3, 24, 32)), "depth": Depth(depth)}
    words = {"max_coc_px": (4.0, 4.0), "depth_kind": "relative", "depth_to": "coc", "lens_to": "lens"}
    out = RandomDepthOfField(lens, **words)(clip)
    scale = range_of(depth.numpy())
    for i in range(2):
        drawn = {name: float(values[i]) for name, values in out["lens"].items()}
        one = dofsim.Lens.from_disparity(**drawn)
        expected = dofsim.coc(depth[i].numpy(), one, depth_kind="relative", depth_range=scale)
        np.testing.assert_allclose(out["depth"][i].numpy(), expected, atol=1e-4)


# Gradients


def pictures():
    generator = torch.Generator().manual_seed(4)
    color = torch.rand(2, 3, 24, 32, generator=generator)
    depth = torch.where(torch.arange(32) < 12, 1.5, 4.0).expand(2, 24, 32).contiguous()
    return color, depth


def test_a_render_with_gradients_is_the_render_and_they_are_those_of_vjp():
    color, depth = (tensor.requires_grad_() for tensor in pictures())
    focus = torch.tensor([2.0, 3.0], dtype=torch.float64, requires_grad=True)
    radius = torch.tensor(0.05, dtype=torch.float64, requires_grad=True)
    out = render(color, depth, focus, radius, fov=40.0)
    weights = torch.rand(out.shape, generator=torch.Generator().manual_seed(5))
    out.backward(weights)
    by_radius = 0.0
    for i in range(2):
        lens = dofsim.Lens(aperture_radius=0.05, focus_distance=float(focus[i].detach()), fov=40.0)
        pixels, plane = color[i].detach().numpy().transpose(1, 2, 0), depth[i].detach().numpy()
        expected = dofsim.render(pixels, plane, lens, device="cpu")
        np.testing.assert_array_equal(out[i].detach().numpy().transpose(1, 2, 0), expected)
        names = ("color", "depth", "focus_distance", "aperture_radius")
        found = dofsim.vjp(pixels, plane, lens, weights[i].numpy().transpose(1, 2, 0), wrt=names)
        np.testing.assert_array_equal(color.grad[i].numpy().transpose(1, 2, 0), found["color"])
        np.testing.assert_array_equal(depth.grad[i].numpy(), found["depth"])
        assert float(focus.grad[i]) == pytest.approx(found["focus_distance"])
        by_radius += found["aperture_radius"]
    assert radius.grad.shape == ()
    assert float(radius.grad) == pytest.approx(by_radius)


def test_only_what_needs_a_gradient_gets_one():
    color, depth = pictures()
    depth.requires_grad_()
    render(color, depth.unsqueeze(1), 2.0, 0.05, fov=40.0).sum().backward()
    assert color.grad is None
    assert depth.grad.shape == depth.shape


def test_vmap_renders_one_picture_after_another():
    color, depth = pictures()
    focus = torch.tensor([2.0, 3.0])

    def one(color, depth, focus):
        return render(color, depth, focus, 0.05, fov=40.0)

    mapped = torch.func.vmap(one)(color, depth, focus)
    assert torch.equal(mapped, render(color, depth, focus, 0.05, fov=40.0))
    shared = torch.func.vmap(one, in_dims=(None, None, 0))(color[0], depth[0], focus)
    assert torch.equal(shared[1], one(color[0], depth[0], focus[1]))


def test_an_optimiser_finds_the_focus():
    color, depth = pictures()
    wanted = render(color[0], depth[0], 2.0, 0.05, fov=40.0)
    focus = torch.tensor(2.3, dtype=torch.float64, requires_grad=True)
    optimiser = torch.optim.Adam([focus], lr=0.05)
    for _ in range(60):
        optimiser.zero_grad()
        (render(color[0], depth[0], focus, 0.05, fov=40.0) - wanted).square().sum().backward()
        optimiser.step()
    assert float(focus.detach()) == pytest.approx(2.0, abs=0.02)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"color": torch.rand(24, 32)}, r"color must have shape \(\.\.\., C, H, W\); got \(24, 32\)"),
        ({"depth": torch.rand(24, 31)}, "depth must have shape"),
        ({"color": np.ones((3, 24, 32))}, "color must be a tensor; got ndarray"),
        ({"focus_distance": torch.ones(3)}, "focus_distance must be a number, or one for each picture"),
        ({"color": torch.rand(3, 24, 32, device="meta")}, "color must be on the CPU"),
    ],
)
def test_what_a_render_with_gradients_refuses(changes, message):
    words = {"color": torch.rand(3, 24, 32), "depth": torch.ones(24, 32), "focus_distance": 2.0, **changes}
    with pytest.raises((ValueError, TypeError), match=message):
        render(**words, aperture_radius=0.05, fov=40.0)
