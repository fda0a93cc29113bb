"""From a gearbox to its velocity ratios and defect orders."""

from hums import defect_orders, load_gearbox, solve_kinematics


class Catalogue:
    """Gearboxes of the catalogue, from one stage to planets on planets."""

    params = ("two-stage", "alouette-iii", "wind-turbine-3-stage")
    param_names = ("gearbox",)

    def setup(self, gearbox: str) -> None:
        """Load and solve once."""
        self.gearbox = load_gearbox(gearbox)
        self.kinematics = solve_kinematics(self.gearbox)

    def time_load(self, gearbox: str) -> None:
        """Time reading and checking the declaration."""
        load_gearbox(gearbox)

    def time_solve(self, _: str) -> None:
        """Time the velocity ratios."""
        solve_kinematics(self.gearbox)

    def time_orders(self, _: str) -> None:
        """Time the table of defect orders."""
        defect_orders(self.kinematics)
