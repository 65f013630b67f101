!> What the state is about which modes and responses are computed, and warnings where they are not those of its motion (theory.md,
!> section 9): it passes limits of the model, it is no equilibrium, it accelerates, or its coefficients change with a steady turn.
module present_state
  use kinds, only: wp
  use dynamic_stiffness, only: stiffness_system
  use linear_matrices, only: linear_mechanism
  use linear_state, only: at_equilibrium, elastic_rounding, evaluate_state, linear_system_with, on_masses
  use marker, only: turn
  use scene_run, only: run_state
  use summary_text, only: summary_record
  use text, only: to_text
  use validity, only: validity_watch
  implicit none (type, external)
  private
  public :: warn_of_motion

  real(wp), parameter :: accelerates = 1.0e-6_wp     !! accelerations that are no steady motion's, of those of the motion [-]
  real(wp), parameter :: changes = 1.0e-4_wp         !! of a motion under a load with the present coefficients [-]
  real(wp), parameter :: places(2) = [0.7_wp, 1.9_wp]   !! turns of the fastest body at which coefficients are compared [rad]

contains

  !> Warns of the present state; frozen: modes and responses about it are those of an instant.
  subroutine warn_of_motion(run, text, frozen)
    type(run_state), intent(inout) :: run
    type(summary_record), intent(inout) :: text      !! the summary
    logical, intent(out) :: frozen
    type(validity_watch) :: watch
    real(wp) :: change                               ! [-]
    frozen = .false.
    associate (s => run%sys%m%s, text_of => 'modes and responses are those of the frozen instant')
      if (.not. run%d%static%present) then
        call watch%begin(run%sys%m)
        call watch%note(run%sys%m, run%sys%ev, run%y(1:s%nq), run%y(s%nq + 1:2*s%nq))
        call text%warn(watch%warnings(run%sys%m, run%sys%ev, 'in the linearised state '))
      end if
      if (s%rows == s%nq) return
      if (.not. any(abs(run%y(s%nq + 1:2*s%nq)) > 0.0_wp)) then
        frozen = .not. at_equilibrium(run)
        if (frozen) call text%warn('the state about which modes and responses are computed is no equilibrium (it would '// &
                                   'accelerate from rest): they are those of the frozen instant; &static finds the equilibrium')
        return
      end if
      frozen = .not. steady(run)
      if (frozen) then
        call text%warn('the state about which modes and responses are computed accelerates: '//text_of// &
                       ' (&static finds states that turn steadily, &periodic motions that repeat)')
        return
      end if
      change = largest_change(run)
      frozen = change > changes
      if (frozen) call text%warn('the scene turns steadily, and the coefficients of its equations change with the turn (what a '// &
        'load moves, by '//to_text(real(nint(1000*min(change, 1.0e3_wp)), wp)/10)//' %): '//text_of//', whose frequencies and '// &
        'growth are not those of the motion; &periodic with multipliers has these')
    end associate
  end subroutine warn_of_motion

  !> Whether all bodies turn steadily about points at rest, or move on steadily, undeformed by it any further: what their
  !> accelerations differ by from those of such motions, as kinetic energies, is small or rounding.
  logical function steady(run)
    type(run_state), intent(in) :: run
    real(wp) :: difference, whole                    ! [N2/kg]
    real(wp), allocatable :: a(:), u(:)              ! (nq) [m/s2, rad/s2]
    integer :: b, i
    associate (m => run%sys%m, nq => run%sys%m%s%nq)
      a = run%sys%ev%a
      allocate (u(nq), source=0.0_wp)
      do b = 1, size(m%s%bodies)
        i = m%s%qo(b)
        u(i + 1:i + 2) = run%y(nq + i + 3)*turn(run%y(nq + i + 1:nq + i + 2))
        a(i + 1:i + 2) = a(i + 1:i + 2) - u(i + 1:i + 2)
        u(i + 3) = run%y(nq + i + 3)**2
        if (m%s%bodies(b)%flexible) a(i + 4:i + 3 + m%s%bodies(b)%nf) = a(i + 4:i + 3 + m%s%bodies(b)%nf) &
                                                                        + run%y(nq + i + 3)*run%y(nq + i + 4:nq + i + 3 + &
                                                                                                  m%s%bodies(b)%nf)
      end do
      difference = on_masses(run, a)
      whole = on_masses(run, run%sys%ev%a) + on_masses(run, u) + &
              sum(m%s%bodies%mass)*sum(run%sys%ev%options%gravity**2)
      steady = sqrt(difference) <= max(accelerates*sqrt(whole), elastic_rounding(run))
    end associate
  end function steady

  !> How much what a load moves differs at other places of a steady turn from what it moves here, by the dynamic stiffness on
  !> the joints at a complex frequency as high as the turn. Unknowns are in the bodies' own axes: constant coefficients move alike.
  real(wp) function largest_change(run) result(change)   ! [-]
    type(run_state), intent(inout) :: run
    type(stiffness_system) :: ds
    complex(wp), allocatable :: here(:), there(:)    ! (n) motion by the load [m, rad]
    real(wp), allocatable :: y(:)
    complex(wp), allocatable :: load(:)              ! (n) [N, N m]
    real(wp) :: rate                                 ! [1/s]
    integer :: b, k, nq
    change = 0.0_wp
    associate (m => run%sys%m)
      nq = m%s%nq
      rate = maxval([(max(abs(run%y(nq + m%s%qo(b) + 3)), norm2(run%y(nq + m%s%qo(b) + 1:nq + m%s%qo(b) + 2))/m%s%size), &
                      b=1, size(m%s%bodies))])
      call respond(run%y, here)
      do k = 1, size(places)
        y = later(run, places(k)/rate)
        call respond(y, there)
        if (maxval([0.0_wp, abs(run%sys%ev%rows%phi(:joint_rows(run)))]) > accelerates*m%s%size) there = 0.0_wp   ! it moves on
        change = max(change, size_of(there - here)/size_of(here))
      end do
      call evaluate_state(run%sys, run%sys%options, run%y)
    end associate
  contains
    !> Motion by the load at a state.
    subroutine respond(y, x)
      real(wp), intent(in), contiguous :: y(:)       !! (ny) layout in `scene_model` [m, rad], [m/s, rad/s], [J]
      complex(wp), allocatable, intent(out) :: x(:)  !! (n) [m, rad]
      type(linear_mechanism) :: lin
      complex(wp), allocatable :: z(:)
      integer :: k
      call evaluate_state(run%sys, run%sys%options, y)
      call linear_system_with(run%sys%m, run%sys%ev, y, run%sys%ev%a, run%sys%ev%lambda, run%sys%ev%action, ds, lin)
      if (.not. allocated(load)) load = ds%momentum([(cmplx(sin(1.0_wp + 1.7_wp*k), 0.0_wp, wp), k=1, ds%n)])
      z = ds%padded(load)
      call ds%set(cmplx(0.5_wp, 1.0_wp, wp)*rate, 1.0_wp)
      call ds%factor()
      call ds%solve(z)
      x = z(:ds%n)
    end subroutine respond

    !> The root of a motion's square on the masses.
    real(wp) function size_of(x)                     ! [kg^.5 m]
      complex(wp), intent(in) :: x(:)                !! (n) [m, rad]
      size_of = sqrt(abs(dot_product(x, ds%momentum(x))))
    end function size_of
  end function largest_change

  !> Rows of joints, without those of drives, friction and stops.
  pure integer function joint_rows(run) result(rows)
    type(run_state), intent(in) :: run
    rows = 0
    associate (s => run%sys%m%s)
      if (s%joints > 0) rows = s%constraints(s%joints)%item%first + s%constraints(s%joints)%item%rows - 1
    end associate
  end function joint_rows

  !> The state after a time of a steady motion: each body has turned about the point of it that rests, or moved on.
  pure function later(run, time) result(y)
    type(run_state), intent(in) :: run
    real(wp), intent(in) :: time                     !! [s]
    real(wp), allocatable :: y(:)                    !! (ny) layout in `scene_model` [m, rad], [m/s, rad/s], [J]
    real(wp) :: angle, v(2)                          ! [rad], [m/s]
    integer :: b, i, nq
    y = run%y
    nq = run%sys%m%s%nq
    do b = 1, size(run%sys%m%s%bodies)
      i = run%sys%m%s%qo(b)
      angle = y(nq + i + 3)*time
      v = y(nq + i + 1:nq + i + 2)
      y(i + 3) = y(i + 3) + angle
      if (abs(angle) > 0.0_wp) then                  ! the integral of the velocity, which turns
        y(i + 1:i + 2) = y(i + 1:i + 2) + time/angle*(sin(angle)*v + (1 - cos(angle))*turn(v))
      else
        y(i + 1:i + 2) = y(i + 1:i + 2) + time*v
      end if
      y(nq + i + 1:nq + i + 2) = cos(angle)*v + sin(angle)*turn(v)
    end do
  end function later
end module present_state
