!> Pins that lock by themselves. The reaction of a slipping pin passes beside its centre by the friction radius, the coefficient
!> times the radius of the pin. Where no force on a body has a longer arm about the pin, none of them turns it there.
module locked_pins
  use assembly_reports, only: add_warning, assembly_report
  use kinds, only: wp
  use mechanism, only: mechanism_model
  use text, only: es_text
  implicit none (type, external)
  private
  public :: warn_of_locked_pins

contains

  !> A warning for each body that a pin holds whatever forces act.
  subroutine warn_of_locked_pins(self, report)
    type(mechanism_model), intent(in) :: self
    type(assembly_report), intent(inout) :: report
    real(wp) :: arm                          ! [m]
    integer :: k, side, marker, b
    do k = 1, size(self%s%friction)
      if (.not. friction_radius(self, k) > 0.0_wp) cycle
      associate (joint => self%s%constraints(self%s%permanent + k)%item%parent)
        do side = 1, 2
          marker = merge(self%s%constraints(joint)%item%ia, self%s%constraints(joint)%item%ib, side == 1)
          b = self%s%markers(marker)%body
          if (b == 0) cycle
          arm = longest_arm(self, b, marker, joint)
          if (friction_radius(self, k) < arm) cycle
          call add_warning(report, 'joint "'//trim(self%s%constraints(joint)%item%name)//'" locks by itself: its static '// &
                           'friction has an arm of '//number(friction_radius(self, k))//' m (coefficient times '// &
                           'pin_radius), and no force on body "'//trim(self%s%bodies(b)%name)//'" one of more than '// &
                           number(arm)//' m about it; expected a pin_radius that is that of the pin (m)')
        end do
      end associate
    end do
  end subroutine warn_of_locked_pins

  !> The arm of the static friction of one of the joints that have it; 0 of what is no pin.
  pure real(wp) function friction_radius(self, k)            ! [m]
    type(mechanism_model), intent(in) :: self
    integer, intent(in) :: k
    friction_radius = self%s%friction(k)%static*self%s%friction(k)%radius
  end function friction_radius

  !> The longest arm about a pin that a force on its body can have: at its mass centre, at other joints, at springs and loads. At
  !> another pin with friction the force passes through its friction circle. Huge where moments act on the body, and where nothing
  !> but its inertia and weight does: a wheel that runs out.
  real(wp) function longest_arm(self, b, marker, joint) result(arm)   ! [m]
    type(mechanism_model), intent(in) :: self
    integer, intent(in) :: b                 !! the body
    integer, intent(in) :: marker            !! of the pin on it
    integer, intent(in) :: joint             !! the pin
    real(wp) :: circle                       ! [m]
    integer :: k, i
    arm = 0.0_wp
    do k = 1, self%s%permanent
      if (k == joint) cycle
      circle = 0.0_wp
      do i = 1, size(self%s%friction)
        if (self%s%constraints(self%s%permanent + i)%item%parent == k) circle = friction_radius(self, i)
      end do
      associate (c => self%s%constraints(k)%item)
        call reach(c%ia, c%ib, c%acts_on(), circle)
        if (c%ic > 0) call reach(c%ic, c%ic, spread(.true., 1, 6), circle)
      end associate
    end do
    do k = 1, self%s%acting
      associate (f => self%s%forces(k)%item)
        call reach(f%ia, f%ib, f%acts, 0.0_wp)
      end associate
    end do
    associate (body => self%s%bodies(b))
      if (arm > 0.0_wp) arm = max(arm, norm2(body%i1/body%mass - self%s%markers(marker)%x))
      if (.not. arm > 0.0_wp) arm = huge(1.0_wp)
    end associate
  contains
    !> What acts at two markers, on x, y and the angle of the first, then of the second.
    subroutine reach(ia, ib, acts, circle)
      integer, intent(in) :: ia, ib
      logical, intent(in) :: acts(6)
      real(wp), intent(in) :: circle         !! [m]
      integer :: at, side
      do side = 1, 2
        at = merge(ia, ib, side == 1)
        if (self%s%markers(at)%body /= b) cycle
        associate (on => acts(3*side - 2:3*side))
          if (on(3)) arm = huge(1.0_wp)
          if (on(1) .or. on(2)) arm = max(arm, norm2(self%s%markers(at)%x - self%s%markers(marker)%x) + circle)
        end associate
      end do
    end subroutine reach
  end function longest_arm

  !> A length for a message.
  function number(x) result(text)
    real(wp), intent(in) :: x                !! [m]
    character(:), allocatable :: text
    text = trim(adjustl(es_text(x, 3)))
  end function number
end module locked_pins
