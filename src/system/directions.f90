!> Lines between two places that need a direction at the start: distance joints, torques about a centre, springs under load.
module directions
  use kinds, only: wp
  use errors, only: failure, status_bad_input
  use distance_joint, only: distance_model
  use load, only: load_about
  use mechanism, only: mechanism_model
  implicit none (type, external)
  private
  public :: require_directions

contains

  !> Refuses an assembled scene in which the ends of such a line coincide, by name.
  subroutine require_directions(self, gap, fail)
    type(mechanism_model), intent(in) :: self
    real(wp), intent(in) :: gap              !! distance up to which places coincide [m]
    type(failure), intent(inout) :: fail
    real(wp) :: d(2)
    integer :: k
    do k = 1, size(self%s%constraints)
      select type (c => self%s%constraints(k)%item)
      type is (distance_model)
        if (c%length <= gap) call fail%raise(status_bad_input, 'joint "'//trim(c%name)//'": its places coincide, so that '// &
          'the link between them has no length; expected two places apart, or type=''revolute''')
      end select
    end do
    do k = 1, size(self%s%loads)
      associate (l => self%s%loads(k))
        if (l%kind /= load_about) cycle
        d = self%p%r(:, l%place) - l%centre
        if (hypot(d(1), d(2)) <= gap) call fail%raise(status_bad_input, 'force "'//trim(l%name)//'": its place is at the '// &
          'centre, where the torque has no arm; expected them apart, or type=''torque''')
      end associate
    end do
    do k = 1, size(self%s%springs)
      associate (s => self%s%springs(k))
        if (s%torsional .or. abs(s%free) <= gap) cycle
        d = self%p%r(:, s%ia) - self%p%r(:, s%ib)
        if (hypot(d(1), d(2)) <= gap) call fail%raise(status_bad_input, 'spring "'//trim(s%name)//'": its places coincide, '// &
          'so that its force has no direction; expected places apart, or free_length=0')
      end associate
    end do
  end subroutine require_directions
end module directions
