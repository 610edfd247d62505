"""Part 21 texts written by hand, after ISO 10303-21: what a reader must get from them is known
without any CAD kernel.
"""

from stepblocks.artefacts.step.exchange import read_exchange_file

SCHEMA = "AP242_MANAGED_MODEL_BASED_3D_ENGINEERING_MIM_LF"
MILLIMETRE = "#1=(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT(.MILLI.,.METRE.));"
RADIAN = "#2=(NAMED_UNIT(*)PLANE_ANGLE_UNIT()SI_UNIT($,.RADIAN.));"
# a shape in millimetres and radians: faces and edges of it are items of #5
SHAPE = f"""{MILLIMETRE}
{RADIAN}
#3=(GEOMETRIC_REPRESENTATION_CONTEXT(3)
GLOBAL_UNIT_ASSIGNED_CONTEXT((#1,#2))REPRESENTATION_CONTEXT('',''));
#5=ADVANCED_BREP_SHAPE_REPRESENTATION('',(),#3);"""


def text_of(data, schema=SCHEMA):
    """Whole file around a data section."""
    return f"""ISO-10303-21;
HEADER;
FILE_DESCRIPTION((''),'2;1');
FILE_NAME('','',(''),(''),'','','');
FILE_SCHEMA(('{schema}'));
ENDSEC;
DATA;
{data}
ENDSEC;
END-ISO-10303-21;
"""


def exchange_of(data, folder, schema=SCHEMA):
    """Instances of a data section, as the program reads them."""
    path = folder / "hand.step"
    path.write_text(text_of(data, schema))
    return read_exchange_file(path)


def placement(number, point, axis=(0.0, 0.0, 1.0)):
    """An axis placement at #number, with its point, axis and second axis in the three numbers
    before.
    """
    across = (0.0, 1.0, 0.0) if abs(axis[0]) > 0.9 else (1.0, 0.0, 0.0)

    def listed(values):
        return ",".join(f"{value:.15E}" for value in values)

    return (
        f"#{number - 3}=CARTESIAN_POINT('',({listed(point)}));"
        f"#{number - 2}=DIRECTION('',({listed(axis)}));"
        f"#{number - 1}=DIRECTION('',({listed(across)}));"
        f"#{number}=AXIS2_PLACEMENT_3D('',#{number - 3},#{number - 2},#{number - 1});"
    )


def face(number, surface, point, axis=(0.0, 0.0, 1.0), *sizes):
    """Face #number on a surface, and the shape aspect #(number + 1) that means it; uses six numbers
    before.
    """
    tail = "".join(f",{size:.15E}" for size in sizes)
    return (
        placement(number - 2, point, axis) + f"#{number - 1}={surface}('',#{number - 2}{tail});"
        f"#{number}=ADVANCED_FACE('',(),#{number - 1},.T.);" + aspect(number)
    )


def circle(number, point, axis, radius):
    """Edge #number on a circle, and the shape aspect #(number + 1) that means it."""
    return (
        placement(number - 2, point, axis)
        + f"#{number - 1}=CIRCLE('',#{number - 2},{radius:.15E});"
        f"#{number}=EDGE_CURVE('',$,$,#{number - 1},.T.);" + aspect(number)
    )


def line(number, point, along):
    """Edge #number on a line, and the shape aspect #(number + 1) that means it."""
    (x, y, z), (u, v, w) = point, along
    return (
        f"#{number - 4}=CARTESIAN_POINT('',({x:.15E},{y:.15E},{z:.15E}));"
        f"#{number - 3}=DIRECTION('',({u:.15E},{v:.15E},{w:.15E}));"
        f"#{number - 2}=VECTOR('',#{number - 3},1.);"
        f"#{number - 1}=LINE('',#{number - 4},#{number - 2});"
        f"#{number}=EDGE_CURVE('',$,$,#{number - 1},.T.);" + aspect(number)
    )


def aspect(number):
    """The shape aspect #(number + 1) of an item."""
    return (
        f"#{number + 1}=SHAPE_ASPECT('','',$,.T.);"
        f"#{number + 2}=GEOMETRIC_ITEM_SPECIFIC_USAGE('','',#{number + 1},#5,#{number});\n"
    )
