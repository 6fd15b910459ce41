"""What is written: JSON documents (the docstring of a type explains its keys), pictures, the HTML report.

The keys, their order and their meaning are part of the stable surface. ``blur2view COMMAND --help-all``
prints these explanations, so that the modules of the documents import nothing that takes time.

Matrices are lists of rows. Points are (x, y) in pixels of the upright photograph with (0, 0) at the centre of
the top-left pixel; only the ``params`` of a camera follow COLMAP, where that centre is (0.5, 0.5).
"""
