"""Results of a torque solution: external torques, tooth loads and forces, branches of power, bearing loads."""

from dataclasses import dataclass

from hums.gearbox.components import Vector, closest
from signals._validation import SentenceError


class TorqueError(SentenceError):
    """Torques that do not balance, or that equilibrium cannot determine.

    Examples
    --------
    >>> import hums
    >>> kinematics = hums.solve_kinematics(hums.load_gearbox("two-stage"))
    >>> try:
    ...     hums.solve_torques(kinematics, {"input": 10.0, "output": 10.0})
    ... except hums.TorqueError as error:
    ...     print(str(error)[:82])
    gearbox "two-stage": the torques "input" = 10, "output" = 10 N m do not balance; l
    """


@dataclass(frozen=True, kw_only=True)
class ExternalTorque:
    """An external torque on a link.

    Attributes
    ----------
    link : str
    torque_nm : float
        In N m, about the link's own declared axis.
    power_w : float
        In W, positive into the gearbox.
    """

    link: str
    torque_nm: float
    power_w: float


@dataclass(frozen=True, kw_only=True)
class ToothForces:
    """The components of the force between the teeth of one contact at the pitch point, magnitudes in N.

    The tangential force drives the driven gear, the radial one separates the gears, the axial one acts along the
    axes.
    """

    tangential_n: float
    radial_n: float
    axial_n: float


@dataclass(frozen=True, kw_only=True)
class ToothLoad:
    """The load of one contact of a mesh, one for each copy of a planet. NaN where `determinate` is False.

    Attributes
    ----------
    mesh : str
    gears : (str, str)
        Links of the gears, in the order of declaration.
    carrier : str
    determinate : bool
        Whether statics determines the load.
    torques_nm : (float, float)
        On each gear about its own axis, in N m; that of the driven gear is less the loss.
    carrier_torque_nm : (3,) tuple of float
        On the carrier, the reaction to both gears, in N m. Every copy counts at the direction of the first one.
    gearing_power_w : float
        Power in W from the first gear to the second, relative to the carrier, at the driving gear. The loss of a mesh
        is a fraction of it.
    absolute_power_w : float or None
        The same power in W, relative to the frame, at the gear that turns about the carrier's axis. None where there
        is no such gear (between planets), or where the axis of the carrier itself moves: positions would decide.
    driver : str or None
        The driving gear relative to the carrier; None where no power flows.
    loss_w : float
        In W.
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
    """A branch of power: meshes that act together on a link whose axis is fixed in the frame.

    A gear has a branch for each of its meshes, a carrier one for each set of planets on it, all copies together.
    The torques of a link's branches and its external torque sum to zero.

    Attributes
    ----------
    link : str
    through : tuple of str
        Names of the meshes.
    torque_nm : float
        On the link, in N m.
    power_w : float
        In W, positive into the link.
    """

    link: str
    through: tuple[str, ...]
    torque_nm: float
    power_w: float


@dataclass(frozen=True, kw_only=True)
class BearingLoad:
    """The reaction of the frame on a shaft at one bearing. NaN where statics does not determine it.

    Attributes
    ----------
    bearing : str
    radial_n : (3,) tuple of float
        In N, in the declared coordinates, across the shaft.
    axial_n : float
        In N, positive along the direction of the shaft's axis.
    status : str
        ``"solved"``, or the reason why not. The radial reaction is valid also where only the axial one is
        indeterminate.
    """

    bearing: str
    radial_n: Vector
    axial_n: float
    status: str


@dataclass(frozen=True, kw_only=True)
class Torques:
    """The static equilibrium of a gearbox under load, and the power flow through it.

    Attributes
    ----------
    external : tuple of ExternalTorque
        Of the named links, both the given torques and those that were solved for.
    frame_torque_nm : (3,) tuple of float
        Torque that holds the frame, the reaction to all external torques, in N m in the declared coordinates.
    tooth_loads : tuple of ToothLoad
        One for each contact of two gears.
    branches : tuple of Branch
        Torque and power of the meshes on each link whose axis is fixed in the frame.
    bearing_loads : tuple of BearingLoad
        One for each declared bearing, in the order of declaration.
    input_power_w, output_power_w : float
        Sum of the powers into and out of the gearbox, in W.
    efficiency : float or None
        Output over input power; None where no power flows in, 0 where every link drives (self-locking).
    circulating_ratio : float or None
        Power of the largest branch over the input power: 1 for a single path, below 1 for split power, above 1 for
        circulating power. None without input or with an indeterminate load.
    gearing_ratio : float or None
        Largest power of a mesh relative to its carrier, all its copies together, over the input power; None likewise.
    indeterminate : tuple of str
        Names of the meshes whose loads statics does not determine.

    Examples
    --------
    >>> import hums
    >>> kinematics = hums.solve_kinematics(hums.load_gearbox("planetary-27-36-99"))
    >>> torques = hums.solve_torques(kinematics, {"sun": 27.0, "carrier": None})
    >>> round(torques.torques_nm["carrier"], 9), round(torques.frame_torque_nm[0], 9)
    (-126.0, 99.0)
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
        """External torque of each named link, in N m."""
        return {load.link: load.torque_nm for load in self.external}

    @property
    def losses_w(self) -> dict[str, float]:
        """Power loss of each mesh in W, all its copies together."""
        losses: dict[str, float] = {}
        for load in self.tooth_loads:
            losses[load.mesh] = losses.get(load.mesh, 0.0) + load.loss_w
        return losses

    def at(self, mesh: str) -> tuple[ToothLoad, ...]:
        """Return the tooth loads of one mesh, one for each copy of a planet.

        Parameters
        ----------
        mesh : str
            Name of a mesh of two gears.

        Returns
        -------
        tuple of ToothLoad

        Raises
        ------
        TorqueError
            If there is no such mesh.
        """
        found = tuple(load for load in self.tooth_loads if load.mesh == mesh)
        if not found:
            names = list(dict.fromkeys(load.mesh for load in self.tooth_loads))
            raise TorqueError(f'no mesh "{mesh}" of two gears{closest(mesh, names)}')
        return found
