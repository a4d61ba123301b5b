"""JPEG files with depth in them, put together as phones do."""

import base64
import io as bytes_io
import struct

from PIL import Image as Pillow


def bytes_of(picture, kind="PNG"):
    buffer = bytes_io.BytesIO()
    Pillow.fromarray(picture).save(buffer, format=kind)
    return buffer.getvalue()


def segment(body, marker=0xE1):
    return bytes((0xFF, marker)) + struct.pack(">H", len(body) + 2) + body


def xmp(attributes, inner=""):
    text = (
        '<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">'
        f"<rdf:Description {attributes}>{inner}</rdf:Description></rdf:RDF></x:xmpmeta>"
    )
    return text.encode()


def with_gdepth(path, codes, form="RangeInverse", near=1.0, far=8.0):
    """Put a depth map into a JPEG as Google's camera did: its bytes are in parts of extended XMP."""
    name = 'xmlns:GDepth="http://ns.google.com/photos/1.0/depthmap/" '
    head = xmp(
        f'{name}GDepth:Format="{form}" GDepth:Near="{near}" GDepth:Far="{far}" GDepth:Mime="image/png"'
    )
    data = base64.b64encode(bytes_of(codes)).decode()
    tail = xmp(f'{name}GDepth:Data="{data}"')
    parts = b""
    for start in range(0, len(tail), 1000):
        parts += segment(
            b"http://ns.adobe.com/xmp/extension/\0"
            + b"A" * 32
            + struct.pack(">II", len(tail), start)
            + tail[start : start + 1000]
        )
    content = path.read_bytes()
    path.write_bytes(content[:2] + segment(b"http://ns.adobe.com/xap/1.0/\0" + head) + parts + content[2:])


def with_dynamic_depth(path, codes, length=None):
    """Put a depth map behind a JPEG, as Dynamic Depth does, with another picture behind it."""
    data, other = bytes_of(codes), bytes_of(codes, "JPEG")
    names = (
        'xmlns:Container="http://ns.google.com/photos/1.0/container/" '
        'xmlns:Item="http://ns.google.com/photos/1.0/container/item/"'
    )
    items = (
        '<Container:Directory><rdf:Seq><rdf:li rdf:parseType="Resource"><Container:Item '
        'Item:Semantic="Primary" Item:Mime="image/jpeg"/></rdf:li><rdf:li rdf:parseType="Resource">'
        '<Container:Item Item:Semantic="Depth" '
        f'Item:Mime="image/png" Item:Length="{len(data) if length is None else length}"/></rdf:li>'
        '<rdf:li rdf:parseType="Resource"><Container:Item Item:Semantic="GainMap" Item:Mime="image/jpeg" '
        f'Item:Length="{len(other)}"/></rdf:li></rdf:Seq></Container:Directory>'
    )
    content = path.read_bytes()
    head = segment(b"http://ns.adobe.com/xap/1.0/\0" + xmp(names, items))
    path.write_bytes(content[:2] + head + content[2:] + data + other)


def gain_jpeg(codes, *parts):
    """Make a JPEG of these codes that says with segments of APP1 and APP2 what they mean."""
    content = bytes_of(codes, "JPEG")
    return content[:2] + b"".join(parts) + content[2:]


def with_further(path, data):
    """Put a picture behind a JPEG, as Multi-Picture Format does."""
    content = path.read_bytes()
    entries = struct.pack(">III", 0x030000, 0, 0) + bytes(4)
    length = 4 + 4 + 8 + 2 + 3 * 12 + 4 + 2 * 16
    # Places count from the header of TIFF, which stands behind the marker, the length and the name.
    entries += struct.pack(">III", 0, len(data), len(content) + length - 10) + bytes(4)
    directory = struct.pack(">H", 3) + struct.pack(">HHI4s", 0xB000, 7, 4, b"0100")
    directory += struct.pack(">HHII", 0xB001, 4, 1, 2) + struct.pack(
        ">HHII", 0xB002, 7, 32, 8 + 2 + 3 * 12 + 4
    )
    part = segment(b"MPF\0" + b"MM\0*" + struct.pack(">I", 8) + directory + bytes(4) + entries, 0xE2)
    assert len(part) == length
    path.write_bytes(content[:2] + part + content[2:] + data)


def iso_gain(*fractions, flags=0):
    """Say in the words of ISO 21496-1 what a gain map means: two headrooms, and five numbers a channel."""
    body = struct.pack(">HHB", 0, 0, flags) + b"".join(struct.pack(">iI", *pair) for pair in fractions)
    return segment(b"urn:iso:std:iso:ts:21496:-1\0" + body, 0xE2)
