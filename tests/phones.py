"""JPEG files with depth in them, put together as phones do."""

import base64
import io as bytes_io
import struct

from PIL import Image as Pillow


def bytes_of(picture, kind="PNG"):
    buffer = bytes_io.BytesIO()
    Pillow.fromarray(picture).save(buffer, format=kind)
    return buffer.getvalue()


def segment(body):
    return b"\xff\xe1" + struct.pack(">H", len(body) + 2) + body


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
