!> What is told of followers on profiles before a run: the least radius of curvature, the largest pressure angle of a law, how far a
!> flat face has to reach; and whether the digits of a table or of points are enough for the curvature, on which forces depend.
module pair_advice
  use kinds, only: wp, pi
  use contact_pair, only: pair_measure
  use curve_profile, only: curve_model, pair_limits
  use deck_records, only: deck
  use law_profile, only: law_model
  use measure, only: measure_model
  use mechanism, only: mechanism_model
  use summary_text, only: summary_record
  use text, only: quoted, to_text
  implicit none (type, external)
  private
  public :: advise_pairs

  real(wp), parameter :: tolerable = 0.05_wp  !! share of the curvature that rounding may be [-]

contains

  !> A line for each pair with a curve that is not a circle; nothing where there is none.
  subroutine advise_pairs(d, m, text)
    type(deck), intent(in) :: d
    type(mechanism_model), intent(in) :: m
    type(summary_record), intent(inout) :: text
    integer :: k
    if (count(d%profiles%kind /= 'circle') == 0) return
    call text%line('')
    call text%line('profiles')
    call text%open('pairs', '[')
    do k = 1, size(d%joints)
      if (d%joints(k)%profile > 0) call one_pair('joint', d%joints(k)%name, m%s%constraints(k)%item%measures(1)%item, text)
    end do
    do k = 1, size(d%stops)
      if (d%stops(k)%profile > 0) call one_pair('stop', d%stops(k)%name, m%s%forces(m%s%switching(k))%item%measure, text)
    end do
    call text%close()
    do k = 1, size(d%profiles)
      call judge_digits(d, k, text)
    end do
  end subroutine advise_pairs

  !> One of them.
  subroutine one_pair(word, name, gap, text)
    character(*), intent(in) :: word, name
    class(measure_model), intent(in) :: gap
    type(summary_record), intent(inout) :: text
    type(pair_limits) :: found
    select type (gap)
    class is (pair_measure)
      select type (curve => gap%profile)
      class is (curve_model)
        call curve%examine(gap%radius, gap%flat, found)
        call text%open('', '{')
        call text%say('  '//word//' "{name='//trim(name)//'}" on "{profile='//trim(curve%name)//'}":')
        if (found%radius < huge(1.0_wp)) call text%say(' least radius of curvature {least_radius 4} m', [found%radius])
        if (gap%flat) call text%say(', the face reaches {reach 4} m to either side', [found%reach])
        select type (curve)
        class is (law_model)
          if (.not. gap%flat .and. abs(gap%radius - curve%inset) <= 0.0_wp) call text%say(', pressure angle up to '// &
            '{pressure_angle 4} rad', [largest_angle(curve)])
        end select
        call text%line('')
        call text%close()
      end select
    end select
  end subroutine one_pair

  !> The largest pressure angle of a law.
  pure real(wp) function largest_angle(curve) result(angle)   ! [rad]
    class(law_model), intent(in) :: curve
    integer :: k
    angle = 0.0_wp
    do k = 0, 719
      angle = max(angle, abs(curve%pressure_angle(2*pi*k/720)))
    end do
  end function largest_angle

  !> Half a unit of the last written digit errs second derivatives by 4/step^2 times that.
  subroutine judge_digits(d, number, text)
    type(deck), intent(in) :: d
    integer, intent(in) :: number                  !! profile
    type(summary_record), intent(inout) :: text
    associate (r => d%profiles(number))
      if (r%kind == 'points') then
        call judge('points of profile', r%name, reshape([r%x, r%y], [size(r%x), 2]), &
                   hypot(r%x(2:) - r%x(:size(r%x) - 1), r%y(2:) - r%y(:size(r%y) - 1)))
      else if (r%kind == 'law') then
        associate (h => d%histories(r%history))
          if (h%kind == 'table') call judge('table', h%name, reshape(h%values/h%value_scale, [size(h%values), 1]), &
                                            h%time(2:) - h%time(:size(h%time) - 1))
        end associate
      end if
    end associate
  contains
    !> Judges numbers at some steps.
    subroutine judge(what, name, x, steps)
      character(*), intent(in) :: what, name
      real(wp), intent(in) :: x(:, :), steps(:)    !! (places, coordinates), (places - 1) [any]
      real(wp) :: share, bend, digit               ! [-], largest curvature, last digit [any]
      integer :: k
      bend = 0.0_wp
      do k = 2, size(x, 1) - 1
        bend = max(bend, norm2((x(k + 1, :) - x(k, :))/steps(k) - (x(k, :) - x(k - 1, :))/steps(k - 1)) &
                   /(0.5_wp*(steps(k - 1) + steps(k))))
      end do
      digit = minval([(last_digit(x(:, k)), k=1, size(x, 2))])   ! who rounds points rounds both alike: the coarser one is exact
      share = 0.5_wp*digit*4/(sum(steps)/size(steps))**2/max(bend, tiny(1.0_wp))
      if (share > tolerable .and. bend > 0.0_wp) call text%warn(what//' '//quoted(trim(name))//' are written to '// &
        to_text(digit)//', which may make the curvature err by '//to_text(anint(100*share))//' % of its largest value; forces '// &
        'on a profile follow it: fewer points, more digits or a law')
    end subroutine judge
  end subroutine judge_digits

  !> The unit of the last decimal of numbers as they were written.
  pure real(wp) function last_digit(x) result(unit)   ! [any]
    real(wp), intent(in) :: x(:)                   !! [any]
    integer :: k
    unit = 0.0_wp
    do k = 0, 15
      unit = 10.0_wp**(-k)
      if (all(abs(x/unit - anint(x/unit)) <= 4*epsilon(1.0_wp)*abs(x/unit))) return
    end do
    unit = 0.0_wp
  end function last_digit
end module pair_advice
