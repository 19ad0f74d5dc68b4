"""Annotate shapes by hand: the few shots that everything else starts from.

How to annotate a folder of meshes, clouds or textured scans:

1.  Put the files at `<root>/<class>/<id>.<ply|obj|glb|…>`, all standing on +y (or say `up`), and write a run file
    with `[dataset] kind = "folder"`, `root = "<root>"`. Where `up` is "auto", shapes are shown as a run found them to
    stand, and before that as a flat underside tells.
2.  `b23d annotate RUN` opens a local page with the first shape that the run needs (`b23d annotate RUN <class>/<id>`:
    with that one). On the first shape of a class, decide which places deserve a keypoint (corners, tips, ends of edges:
    places that one finds again on every shape of the class) and click them in an order that is easy to repeat; ids
    count up from 0 by themselves. Drag to turn, wheel to zoom: a click is exact from near. One a few pixels beside the
    shape takes the surface that looks nearest; with E on, a click takes the tip beside it. Names are for people: one
    that the class's other shapes give to an id is proposed.
3.  While a class lacks shots (`shots.count`), the next shape is the one that most of those without keypoints are like:
    by features and geometry after `b23d run RUN --until reweight`, by geometry after `--until normalize`, else by name.
    Ctrl+S saves into `<root>/keypoints.json` (or the data set's `keypoints` file). Next (N) saves and goes to the next
    shape that is needed.
4.  The first shape now stands beside it. The id to be placed next is marked on it; click the same place on the new
    shape. A part the shape lacks is passed over (`]`): an id means the same on every shape, and not every shape has
    every id; the page says which are missing. Where a symmetric shape could be numbered two ways, choose the way of the
    reference as it is turned in space (both views turn together), never by eye alone.
5.  Three shots a class is what the method needs; `b23d run RUN` then uses them. Annotate further shapes to get scores:
    those that are not shots are compared with their predictions.

A keypoint's `xyz` lies exactly on the surface, in the file's own frame; `mesh_info` says on which face of the file and
where on it (barycentric), `pcd_info` which point of the shape's cloud is nearest.

`geometry` finds what a click hits and `snapping` what it nearly hit, `entries` reads and writes the annotation file,
`session` joins them for a shape, `needed` says which shapes come next, `proposing` which
helps most, by what `looks` knows, `upright` how a shape stands, `walk` goes through them, `server` serves the
page.
"""
