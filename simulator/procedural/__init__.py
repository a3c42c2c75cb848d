"""Buildings of any size from a number: offices and apartment houses (``buildings.generated_home``)."""
