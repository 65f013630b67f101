!> Where everything of the assembled scene stands, for pictures: frames and nodes of the bodies, the markers of joints, drives,
!> springs, forces and sensors. Written as figures of the summary, one line each; words are not added.
module scene_figures
  use growing_text, only: text_buffer
  use kinds, only: wp
  use deck_records, only: deck, marker_record
  use mechanism, only: mechanism_model
  use summary_text, only: json_text, summary_record
  use text, only: to_text
  implicit none (type, external)
  private
  public :: add_scene

contains

  !> Adds the scene.
  subroutine add_scene(d, m, q, text)
    type(deck), intent(in) :: d
    type(mechanism_model), intent(in) :: m
    real(wp), intent(in) :: q(:)               !! (nq) assembled positions [m], [rad]
    type(summary_record), intent(inout) :: text
    integer :: k
    call text%open('scene', '{')
    call text%member('size', to_text(m%s%size))
    call text%member('gravity', vector(d%scene%gravity))
    call text%open('bodies', '[')
    do k = 1, size(d%bodies)
      call add_body(d, m, q, k, text)
    end do
    call text%close()
    call text%open('joints', '[')
    do k = 1, size(d%joints)
      call pair(d%joints(k)%name, d%joints(k)%type, d%joints(k)%a, d%joints(k)%b, d%joints(k)%direction)
    end do
    call text%close()
    call text%open('drives', '[')
    do k = 1, size(d%drives)
      call pair(d%drives(k)%name, d%drives(k)%type, d%drives(k)%a, d%drives(k)%b, d%drives(k)%direction)
    end do
    call text%close()
    call text%open('springs', '[')
    do k = 1, size(d%springs)
      call pair(d%springs(k)%name, d%springs(k)%type, d%springs(k)%a, d%springs(k)%b, 0.0_wp)
    end do
    call text%close()
    call add_forces(d, m, q, text)
    call add_sensors(d, m, q, text)
    call text%close()
  contains
    !> What acts between two markers, with its direction in global axes.
    subroutine pair(name, kind, a, b, direction)
      character(*), intent(in) :: name, kind
      type(marker_record), intent(in) :: a, b
      real(wp), intent(in) :: direction          !! from the section of b [rad]
      call text%member('', item(name, kind)//', "a": '//marker(d, m, q, a)//', "b": '//marker(d, m, q, b)// &
                       ', "direction": '//to_text(direction + angle(m, q, b))//'}')
    end subroutine pair
  end subroutine add_scene

  !> A body: frame, nodes, elements; of a rigid body its mass centre.
  subroutine add_body(d, m, q, k, text)
    type(deck), intent(in) :: d
    type(mechanism_model), intent(in) :: m
    real(wp), intent(in) :: q(:)               !! (nq) [m], [rad]
    integer, intent(in) :: k                   !! body
    type(summary_record), intent(inout) :: text
    type(text_buffer) :: nodes, elements
    integer :: j
    associate (b => m%s%bodies(k), r => d%bodies(k))
      do j = 1, b%nn
        if (j > 1) call nodes%add(', ')
        call nodes%add(vector(position(m, q, marker_record(body=k, node=j))))
      end do
      do j = 1, b%ne
        if (j > 1) call elements%add(', ')
        call elements%add('['//to_text(b%en(1, j))//', '//to_text(b%en(2, j))//']')
      end do
      call text%member('', item(r%name, r%kind)//', "frame": '//vector(q(m%s%qo(k) + 1:m%s%qo(k) + 3))//', "mass": '// &
        to_text(b%mass)//', "centre": '//vector(position(m, q, marker_record(body=k, point=b%i1/b%mass)))// &
        ', "nodes": ['//nodes%all()//'], "elements": ['//elements%all()//']}')
    end associate
  end subroutine add_body

  !> Forces and torques, as they are at factor 1.
  subroutine add_forces(d, m, q, text)
    type(deck), intent(in) :: d
    type(mechanism_model), intent(in) :: m
    real(wp), intent(in) :: q(:)               !! (nq) [m], [rad]
    type(summary_record), intent(inout) :: text
    integer :: k
    call text%open('forces', '[')
    do k = 1, size(d%forces)
      associate (r => d%forces(k))
        call text%member('', item(r%name, r%type)//', "at": '//marker(d, m, q, r%marker)//', "force": '// &
                         vector([r%fx, r%fy])//', "axes": '//json_text(trim(r%axes))//', "moment": '//to_text(r%moment)// &
                         ', "centre": '//vector(r%centre)//'}')
      end associate
    end do
    call text%close()
  end subroutine add_forces

  !> Sensors, each at what it measures; those of joints, drives and springs at their marker a.
  subroutine add_sensors(d, m, q, text)
    type(deck), intent(in) :: d
    type(mechanism_model), intent(in) :: m
    real(wp), intent(in) :: q(:)               !! (nq) [m], [rad]
    type(summary_record), intent(inout) :: text
    type(marker_record) :: at
    integer :: k
    call text%open('sensors', '[')
    do k = 1, size(d%sensors)
      associate (r => d%sensors(k))
        at = r%marker
        if (r%joint > 0) at = d%joints(r%joint)%a
        if (r%drive > 0) at = d%drives(r%drive)%a
        if (r%spring > 0) at = d%springs(r%spring)%a
        if (r%element > 0) at%node = m%s%bodies(at%body)%en(1, r%element)
        call text%member('', item(r%name, r%quantity)//', "at": '//marker(d, m, q, at)//'}')
      end associate
    end do
    call text%close()
  end subroutine add_sensors

  !> The beginning of an item: its name and its kind.
  function item(name, kind) result(text)
    character(*), intent(in) :: name, kind
    character(:), allocatable :: text
    text = '{"name": '//json_text(trim(name))//', "kind": '//json_text(trim(kind))
  end function item

  !> A marker: its body (null: the ground), its node (0: a point), where it is.
  function marker(d, m, q, r) result(text)
    type(deck), intent(in) :: d
    type(mechanism_model), intent(in) :: m
    real(wp), intent(in) :: q(:)               !! (nq) [m], [rad]
    type(marker_record), intent(in) :: r
    character(:), allocatable :: text
    text = 'null'
    if (r%body > 0) text = json_text(trim(d%bodies(r%body)%name))
    text = '{"body": '//text//', "node": '//to_text(r%node)//', "at": '//vector(position(m, q, r))//'}'
  end function marker

  !> Where a marker is.
  function position(m, q, r) result(x)
    type(mechanism_model), intent(in) :: m
    real(wp), intent(in) :: q(:)               !! (nq) [m], [rad]
    type(marker_record), intent(in) :: r
    real(wp) :: x(2)                           !! [m]
    real(wp) :: u(3), c, s
    x = r%point
    if (r%body == 0) return
    associate (b => m%s%bodies(r%body), frame => q(m%s%qo(r%body) + 1:m%s%qo(r%body) + 3))
      if (r%node > 0) then
        u = b%displacement(r%node, q(m%s%qo(r%body) + 4:m%s%qo(r%body) + 3 + b%nf))
        x = b%x(:, r%node) + u(1:2)
      end if
      c = cos(frame(3))
      s = sin(frame(3))
      x = frame(1:2) + [c*x(1) - s*x(2), s*x(1) + c*x(2)]
    end associate
  end function position

  !> Angle of the section of a marker, of the frame where it has none.
  function angle(m, q, r) result(a)
    type(mechanism_model), intent(in) :: m
    real(wp), intent(in) :: q(:)               !! (nq) [m], [rad]
    type(marker_record), intent(in) :: r
    real(wp) :: a                              !! [rad]
    real(wp) :: u(3)
    a = 0.0_wp
    if (r%body == 0) return
    a = q(m%s%qo(r%body) + 3)
    associate (b => m%s%bodies(r%body))
      if (r%node == 0) return
      u = b%displacement(r%node, q(m%s%qo(r%body) + 4:m%s%qo(r%body) + 3 + b%nf))
      a = a + u(3)
    end associate
  end function angle

  !> Numbers as a JSON list, to the 6 figures that a picture needs.
  function vector(x) result(text)
    real(wp), intent(in) :: x(:)               !! [m], [rad] or any other unit
    character(:), allocatable :: text
    integer :: k
    text = '['
    do k = 1, size(x)
      if (k > 1) text = text//', '
      text = text//to_text(x(k))
    end do
    text = text//']'
  end function vector
end module scene_figures
