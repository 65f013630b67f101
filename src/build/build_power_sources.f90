!> What the power of a sensor comes from, and the list of those whose powers the state integrates.
module build_power_sources
  use deck_records, only: deck, sensor_record
  use scene_model, only: power_source, scene
  implicit none (type, external)
  private
  public :: friction_of, list_integrated, source_of

contains

  !> Sources whose powers are integrated, in the deck's order of their sensors.
  subroutine list_integrated(d, s)
    type(deck), intent(in) :: d
    type(scene), intent(inout) :: s              !! its constraints and force elements are made
    integer :: k, n
    allocate (s%integrated(count(d%sensors%quantity == 'work' .or. d%sensors%quantity == 'energy')))
    n = 0
    do k = 1, size(d%sensors)
      if (.not. any(d%sensors(k)%quantity == [character(6) :: 'work', 'energy'])) cycle
      n = n + 1
      s%integrated(n) = source_of(s, d%sensors(k))
      s%integrated(n)%sensor = k
    end do
  end subroutine list_integrated

  !> The drive, force, spring, joint or body that a sensor names.
  pure type(power_source) function source_of(s, r) result(source)
    type(scene), intent(in) :: s
    type(sensor_record), intent(in) :: r
    source%body = r%marker%body
    if (r%force > 0) source%element = s%springs + r%force
    if (r%spring > 0) source%element = r%spring
    if (r%drive > 0) source%drive = s%joints + r%drive
    if (r%joint > 0) source%joint = [r%joint, friction_of(s, r%joint)]
  end function source_of

  !> The constraint that is a joint's friction; none where it has none.
  pure function friction_of(s, joint) result(row)
    type(scene), intent(in) :: s
    integer, intent(in) :: joint                 !! its number, 0: no joint
    integer, allocatable :: row(:)
    integer :: k
    row = [(s%permanent + k, k=1, size(s%friction))]
    row = pack(row, [(s%constraints(row(k))%item%parent == joint, k=1, size(row))])
    if (joint == 0) row = row(:0)
  end function friction_of
end module build_power_sources
