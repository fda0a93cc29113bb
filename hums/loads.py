"""What a solved equilibrium consists of: torques, tooth loads and forces, branches of power, bearing loads."""

from dataclasses import dataclass

from hums.declared import closest
from hums.gearbox import Vector


class TorqueError(ValueError):
    """Torques that do not balance, that nothing can take, or that cannot be told apart."""


@dataclass(frozen=True, kw_only=True)
class ExternalTorque:
    """What the outside puts on a link.

    Attributes
    ----------
    torque_nm : float, N m, about the link's own declared axis
    power_w : float, W, positive into the gearbox
    """

    link: str
    torque_nm: float
    power_w: float


@dataclass(frozen=True, kw_only=True)
class ToothForces:
    """The force between the teeth of one contact, in N, as magnitudes at the pitch point.

    The tangential force turns the driven gear, the radial one pushes the gears apart (a ring outwards), the axial
    one acts along the axes.
    """

    tangential_n: float
    radial_n: float
    axial_n: float


@dataclass(frozen=True, kw_only=True)
class ToothLoad:
    """One contact of a mesh, a planet's copies each counted. NaN where `determinate` is False.

    Attributes
    ----------
    gears : pair of link names, in the order of declaration
    torques_nm : pair of float, N m
        On each gear about its own axis; that of the driven gear is less the loss.
    carrier_torque_nm : (3,) N m
        On the carrier, which takes the reaction of both gears. A copy counts where the first one stands.
    gearing_power_w : float, W
        Power that flows from the first gear to the second as the carrier sees it, which is what a mesh loses a
        part of; measured at the gear that drives.
    absolute_power_w : float or None, W
        The same flow as the frame sees it, measured at the gear that turns about the carrier's axis. None where
        there is no such gear (between planets), or the carrier is carried itself: positions would decide.
    driver : str or None
        The gear that drives as the carrier sees it; None where no power flows.
    loss_w : float, W
    forces : ToothForces or None
        None where the mesh declares no module or no pressure angle, or its axes are not parallel.
    """

    mesh: str
    gears: tuple[str, str]
    carrier: str
    determinate: bool
    torques_nm: tuple[float, float]
    carrier_torque_nm: Vector
    gearing_power_w: float
    absolute_power_w: float | None
    driver: str | None
    loss_w: float
    forces: ToothForces | None


@dataclass(frozen=True, kw_only=True)
class Branch:
    """One place where the meshes act on a link that turns about an axis at rest.

    A gear has a branch for each of its meshes, a carrier one for each set of planets it holds, all copies together.
    The branches of a link and its external torque add up to nothing.

    Attributes
    ----------
    through : names of the meshes that act there
    torque_nm : float, N m, on the link
    power_w : float, W, positive into the link
    """

    link: str
    through: tuple[str, ...]
    torque_nm: float
    power_w: float


@dataclass(frozen=True, kw_only=True)
class BearingLoad:
    """The reaction of the frame on a shaft at one bearing. NaN where it is not settled.

    Attributes
    ----------
    radial_n : (3,) N, in the declared coordinates, across the shaft
    axial_n : float, N, positive along the direction of the shaft's axis
    status : str
        ``"solved"``, or what stands in the way, in words. Where only the share in the axial force is open, the
        radial reaction stands.
    """

    bearing: str
    radial_n: Vector
    axial_n: float
    status: str


@dataclass(frozen=True, kw_only=True)
class Torques:
    """Static equilibrium of a gearbox under load, and the flow of power through it.

    Attributes
    ----------
    external : torques on the links that were named, given ones and those that take the balance
    frame_torque_nm : (3,) N m
        What holds the frame: the reaction to all external torques, in the declared coordinates.
    tooth_loads : one for each contact of two gears
    branches : what the meshes put on each link that turns about an axis at rest
    bearing_loads : one for each declared bearing, in the order of declaration
    input_power_w, output_power_w : float, W
        What flows in by all links together, and what flows out.
    efficiency : float or None
        Output over input; None where no power flows in, 0 where every link has to drive (a box that locks itself).
    circulating_ratio : float or None
        Power of the largest branch over the input: 1 where one stream runs through, below 1 where it divides,
        above 1 where power circulates. None without input or where a load is indeterminate.
    gearing_ratio : float or None
        Largest power of a mesh relative to its carrier, its copies together, over the input; None likewise.
    indeterminate : names of the meshes whose loads statics does not settle
    """

    external: tuple[ExternalTorque, ...]
    frame_torque_nm: Vector
    tooth_loads: tuple[ToothLoad, ...]
    branches: tuple[Branch, ...]
    bearing_loads: tuple[BearingLoad, ...]
    input_power_w: float
    output_power_w: float
    efficiency: float | None
    circulating_ratio: float | None
    gearing_ratio: float | None
    indeterminate: tuple[str, ...]

    @property
    def torques_nm(self) -> dict[str, float]:
        """External torque in N m by link."""
        return {load.link: load.torque_nm for load in self.external}

    @property
    def losses_w(self) -> dict[str, float]:
        """Power lost in W by mesh, its copies together."""
        losses: dict[str, float] = {}
        for load in self.tooth_loads:
            losses[load.mesh] = losses.get(load.mesh, 0.0) + load.loss_w
        return losses

    def at(self, mesh: str) -> tuple[ToothLoad, ...]:
        """Return the contacts of one mesh, a planet's copies each counted."""
        found = tuple(load for load in self.tooth_loads if load.mesh == mesh)
        if not found:
            names = list(dict.fromkeys(load.mesh for load in self.tooth_loads))
            raise TorqueError(f'no mesh "{mesh}" of two gears{closest(mesh, names)}')
        return found
