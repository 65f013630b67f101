!> How far a core is from the stiffness that damps most (theory.md, section 16), in words of `--check`.
module core_advice
  use kinds, only: wp, pi
  use body, only: body_model
  use layer_limits, only: modulus_ratio
  use layered_section, only: layered_section_model
  use mechanism, only: mechanism_model
  use summary_text, only: summary_record
  use text, only: either
  use validity, only: lowest_frequency
  implicit none (type, external)
  private
  public :: core_lines

contains

  !> A line for each section of a body with one viscoelastic core.
  subroutine core_lines(m, text)
    type(mechanism_model), intent(in) :: m
    type(summary_record), intent(inout) :: text
    real(wp) :: omega                                ! [rad/s]
    integer :: b, k
    call text%open('cores', '[')
    do b = 1, size(m%s%bodies)
      associate (body => m%s%bodies(b))
        if (.not. body%flexible) cycle
        if (all(body%layers%sections%cores /= 1)) cycle
        omega = lowest_frequency(body)
        if (.not. omega < huge(1.0_wp)) cycle
        do k = 1, size(body%layers%sections)
          if (body%layers%sections(k)%cores == 1) call one_core(body, body%layers%sections(k), omega, text)
        end do
      end associate
    end do
    call text%close()
  end subroutine core_lines

  !> Mead & Markus: a wave k of a full cover has the stiffness D (1 + Y g/(g + k2)), whose loss factor is largest where
  !> Re g/k2 = 1/sqrt((1 + Y)(1 + eta2)).
  subroutine one_core(body, s, omega, text)
    type(body_model), intent(in) :: body
    type(layered_section_model), intent(in) :: s
    real(wp), intent(in) :: omega                    !! [rad/s]
    type(summary_record), intent(inout) :: text
    complex(wp) :: modulus                           ! over that at rest [-]
    real(wp) :: ea(2), axis(2), bending, y, g, eta, k2, best   ! [N], [m], [N m2], [-], [1/m2], [-], [1/m2], [-]
    integer :: l, i
    l = findloc(s%layers%core, 1, 1)
    modulus = modulus_ratio(body, s%layers(l), omega)
    if (.not. aimag(modulus) > 0.0_wp) return
    bending = 0.0_wp
    do i = 1, 2
      associate (face => s%layers(merge(1, l + 1, i == 1):merge(l - 1, size(s%layers), i == 1)))
        ea(i) = sum(face%young*face%area)
        axis(i) = sum(face%young*face%area*face%height)/ea(i)
        bending = bending + sum(face%young*(face%second + face%area*(face%height - axis(i))**2))
      end associate
    end do
    y = (axis(2) - axis(1))**2*ea(1)*ea(2)/(sum(ea)*bending)
    g = real(modulus, wp)*s%layers(l)%shear*s%layers(l)%area/s%layers(l)%thickness**2*sum(1/ea)
    eta = aimag(modulus)/real(modulus, wp)
    k2 = 0.0_wp
    do i = 1, 60                                     ! each halves the error
      k2 = omega*sqrt(sum(s%layers%density*s%layers%area)/(bending*(1 + y*g/(g + k2))))
    end do
    best = 1/sqrt((1 + y)*(1 + eta**2))
    call text%item('  core, layer {layer #} of body "{body='//trim(body%name)//'}", at {frequency} Hz, the lowest frequency '// &
                   'of the body: a full cover, simply supported, would have the loss factor {loss_factor}, at most '// &
                   '{most_by_stiffness} with g/k2 = {best_g_over_k2} in place of {g_over_k2}, by '// &
                   either('less', 'more', g/k2 > best)//' modulus over thickness', &
                   [real(wp) :: l, omega/(2*pi), loss(g/k2), loss(best), best, g/k2])
  contains
    !> Loss factor of the wave.
    real(wp) function loss(x)                        ! [-]
      real(wp), intent(in) :: x                      !! Re g/k2 [-]
      complex(wp) :: stiffness                       ! over D [-]
      stiffness = x*cmplx(1.0_wp, eta, wp)
      stiffness = 1 + y*stiffness/(1 + stiffness)
      loss = aimag(stiffness)/real(stiffness, wp)
    end function loss
  end subroutine one_core
end module core_advice
