"""Bodies from files: robot descriptions, mass properties of CAD programs, and meshes.

A base of `rigidmc.scene.body.Body`.
"""

import os
import warnings
from typing import TYPE_CHECKING, Any, Self

from rigidmc.errors import SceneError, SceneWarning, in_file, unknown
from rigidmc.inputs.arrays import Array
from rigidmc.scene import shape
from rigidmc.scene.body_changes import BodyChanges
from rigidmc.scene.inertia_about import positive_number
from rigidmc.scene.stated import MESH

if TYPE_CHECKING:
    from trimesh import Trimesh

SOLIDS_OF_MESH = ("solid", "hull", "shell")


class BodyReaders(BodyChanges):
    """Class methods of Body that read a file."""

    @classmethod
    def read(
        cls,
        path: str | os.PathLike[str],
        *,
        link: str | None = None,
        pivot: Any = None,
        products: str | None = None,
        about: str | None = None,
        density: float | None = None,
        mass: float | None = None,
        scale: float | None = None,
        solid: str = "solid",
    ) -> Self:
        """Make a body from a file: URDF, MJCF, mass properties of a CAD program, or a mesh.

        The described axes are the axes of the link, body or drawing, and the fixed point is their
        origin, unless `pivot` gives another. Links fixed to a link are included. What is assumed is
        reported by SceneWarning.

        Parameters
        ----------
        path : str or path
            .urdf, .xml or .mjcf (the root element decides), .txt (SolidWorks and Onshape), or .stl,
            .obj, .ply, .off (extra `mesh`)
        link : str, optional
            name of the link of a URDF file, or of the body of an MJCF file
        pivot : array_like (3,) or "centre", optional [m]
            another fixed point, in the described axes
        products : str, optional
            "positive" if the products of inertia of a text are +int x y dm, "negative" if they are
            -int x y dm; by default the text decides
        about : str, optional
            "centre" or "pivot", the point of a tensor, for a text that does not say it
        density, mass : float, optional [kg/m^3, kg]
            of a mesh, either one
        scale : float, optional [m]
            metres per unit of a mesh; by default 0.001 if a mesh would be larger than 10 m, or if
            only then its mass and volume make a density of matter, else 1
        solid : str, optional
            of a mesh: "solid", uniform within a closed mesh; "hull", uniform within its convex
            hull; "shell", a thin sheet of the given mass along its triangles

        Returns
        -------
        Body
            the body

        Raises
        ------
        SceneError
            for an option that the file does not have, for a text that reads two ways, and for an
            impossible body
        FileError
            for a file that cannot be used

        Examples
        --------
        >>> rm.Body.read("arm.urdf", link="forearm")
        Traceback (most recent call last):
        FileNotFoundError: [Errno 2] No such file or directory: 'arm.urdf'
        """
        from rigidmc.scene.body_files import find_part, is_mesh, refuse_options

        name = os.fspath(path)
        if is_mesh(name):
            refuse_options({"link": link, "products": products, "about": about}, "a mesh has none")
            body = cls._of_mesh_file(name, density, mass, scale, solid)
        else:
            form = None if solid == "solid" else solid
            of_mesh = {"density": density, "mass": mass, "scale": scale, "solid": form}
            refuse_options(of_mesh, "is for meshes only")
            body_found = find_part(name, link, products, about)
            for note in body_found.notes:
                warnings.warn(f"{name}: {note}", SceneWarning, stacklevel=2)
            part = body_found.part
            with in_file(name):
                body = cls._of_tensor(part.about_origin(), part.mass, tuple(part.centre.tolist()))
        if pivot is None:
            return body
        is_centre = isinstance(pivot, str) and pivot == "centre"
        return body.with_pivot_at_centre() if is_centre else body.with_pivot(pivot)

    @classmethod
    def _of_mesh_file(
        cls, path: str, density: float | None, mass: float | None, scale: float | None, solid: str
    ) -> Self:
        """Implement `read` for a mesh, and guess its unit."""
        from rigidmc.mechanics import mesh
        from rigidmc.scene.body_files.mesh_units import guess_scale

        if scale is not None:
            return cls.from_mesh(path, density, mass, scale, solid)
        triangles = mesh.load(path, 1.0, _is_solid(solid))
        scale, note = guess_scale(triangles, mass if solid == "solid" else None)
        if note:
            warnings.warn(f"{path}: {note}", SceneWarning, stacklevel=3)
        triangles *= scale
        return cls._of_triangles(triangles, density, mass, solid, path, scale)

    @classmethod
    def from_mesh(
        cls,
        path: "str | Trimesh",
        density: float | None = None,
        mass: float | None = None,
        scale: float = 1.0,
        solid: str = "solid",
    ) -> Self:
        """Make a body of uniform density from a triangle mesh.

        It rotates about the origin of the mesh. A closed mesh whose triangles all face inward is
        turned inside out, with a SceneWarning.

        Parameters
        ----------
        path : str or trimesh.Trimesh
            STL, OBJ, PLY or OFF file (extra `mesh`), or a mesh
        density : float, optional [kg/m^3]
            density; give either density or mass
        mass : float, optional [kg]
            mass of the body
        scale : float, optional [m]
            metres per unit of the file
        solid : str, optional
            "solid", the volume within a closed mesh; "hull", its convex hull; "shell", a thin sheet
            along the triangles, which needs a mass. The last two also take meshes with holes

        Returns
        -------
        Body
            the body

        Raises
        ------
        SceneError
            for a mesh that is not watertight, and for both or neither of density and mass

        Examples
        --------
        >>> rm.Body.from_mesh("part.stl")
        Traceback (most recent call last):
        rigidmc.errors.SceneError: [body.mesh] density: give either density or mass
        """
        from rigidmc.mechanics import mesh

        closed = _is_solid(solid)
        if (density is None) == (mass is None):
            raise SceneError("give either density or mass", at="body.mesh.density", value=density)
        size = positive_number(scale, "body.mesh.scale")
        loaded = mesh.load(path, size, closed)
        file = None if isinstance(path, mesh.Mesh) else os.fspath(path)
        return cls._of_triangles(loaded, density, mass, solid, file, size)

    @classmethod
    def _of_triangles(
        cls,
        triangles: Array,
        density: float | None,
        mass: float | None,
        solid: str,
        file: str | None,
        scale: float,
    ) -> Self:
        """Make a body from checked triangles (n, 3, 3) [m] of a file or a mesh."""
        from rigidmc.mechanics import mesh

        if (density is None) == (mass is None):
            raise SceneError("give either density or mass", at="body.mesh.density", value=density)
        if solid == "shell":
            if mass is None:
                rule = "a thin shell has no volume: give its mass"
                raise SceneError(rule, at="body.mesh.density", value=density)
            volume, centre, tensor = mesh.shell_properties(triangles)
        else:
            outward, reversed_all = mesh.faced_outward(triangles)
            if solid == "hull":
                outward = mesh.convex_hull(triangles)
            elif reversed_all:
                note = f"{file or 'the mesh'}: all its triangles faced inward, and were turned"
                warnings.warn(note, SceneWarning, stacklevel=3)
            volume, centre, tensor = mesh.mass_properties(outward, 1.0)
        if mass is None:
            by = positive_number(density, "body.mesh.density")
        else:
            by = positive_number(mass, "body.mesh.mass") / volume
        if file is None:
            part = shape.shape_of_mesh(triangles)
        else:
            part = shape.shape_of_mesh_file(file, scale)
        properties = by * tensor, float(by * volume), tuple(centre.tolist())
        return cls._of_tensor(*properties, (part,), stated=MESH)


def _is_solid(solid: Any) -> bool:
    """Return whether a mesh is to be closed; SceneError for a word not in SOLIDS_OF_MESH."""
    if solid not in SOLIDS_OF_MESH:
        raise unknown("solid of a mesh", SOLIDS_OF_MESH, at="body.mesh.solid", value=solid)
    return bool(solid == "solid")
