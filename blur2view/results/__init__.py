"""What is written: JSON documents, pictures, the HTML report.

The keys, their order and their meaning are part of the stable surface. ``record`` explains each beside its
field; ``blur2view COMMAND --help-all`` prints these explanations, so that it imports nothing that takes time.

Matrices are lists of rows. Points are (x, y) in pixels of the upright photograph with (0, 0) at the centre of
the top-left pixel; only the ``params`` of a camera follow COLMAP, where that centre is (0.5, 0.5).
"""
